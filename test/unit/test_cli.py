# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The command line: help, parameter files, progress on a terminal only."""

from collections.abc import Iterator
import os
from pathlib import Path
import signal
import struct
import subprocess
import sys
import time

from helpers import ROOT, write_fake_bag
from pace import patient
import pytest
from somfusion_ros import __version__
from somfusion_ros.cli.main import main, parser
from somfusion_ros.cli.replay import bag_options
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Pose
from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.errors import InputError
from somfusion_ros.io.parameters import make, read_parameters
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.slam.config import SlamConfig

COMMAND = [sys.executable, '-m', 'somfusion_ros.cli.main']
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}


@pytest.mark.parametrize('command', ['replay', 'merge', 'simulate', 'report'])
def test_help(command: str, capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([command, '--help'])
    assert stopped.value.code == 0
    assert f'usage: somfusion {command}' in capsys.readouterr().out


def test_version(capsys: pytest.CaptureFixture) -> None:
    with pytest.raises(SystemExit):
        main(['--version'])
    assert __version__ in capsys.readouterr().out


def test_progress_bar_on_a_terminal_none_in_a_pipe(tmp_path: Path) -> None:
    fcntl, pty, termios = (pytest.importorskip(name) for name in ('fcntl', 'pty', 'termios'))
    arguments = [*COMMAND, 'simulate', '--robots', '1', '--duration', '3', '--output',
                 str(tmp_path)]
    piped = subprocess.run(arguments, capture_output=True, timeout=60, env=ENVIRONMENT)
    assert (piped.returncode, piped.stderr) == (0, b'')
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack('4H', 24, 100, 0, 0))
    done = subprocess.run(arguments, stdout=subprocess.PIPE, stderr=theirs, timeout=60,
                          env=ENVIRONMENT)
    os.close(theirs)
    shown = os.read(ours, 65536)
    os.close(ours)
    assert done.returncode == 0
    assert b'robot1' in shown and b'scan/s' in shown


def test_parameter_files_of_the_nodes_are_the_defaults() -> None:
    values = read_parameters([ROOT / 'config' / 'slam.yaml', ROOT / 'config' / 'fusion.yaml'])
    assert make(SlamConfig, values) == SlamConfig()
    assert make(FusionConfig, values) == FusionConfig()


def test_parameter_file(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text('slam_node:\n  ros__parameters:\n    resolution: 0.1\n'
                    'fusion_node:\n  ros__parameters:\n    estimation_confidence: 1\n')
    values = read_parameters([path])
    assert make(SlamConfig, values).resolution == 0.1
    assert make(SlamConfig, values, resolution=0.2).resolution == 0.2
    assert make(FusionConfig, values).estimation_confidence == 1


def test_a_replay_takes_the_lasers_mount_and_the_odometry_of_the_parameter_file() -> None:
    def options(file: dict[str, object], *given: str) -> BagOptions:
        command = parser().parse_args(['replay', 'bag', '--output', 'out', *given])
        return bag_options(command, file)

    file = {'laser_pose': [0.1, 0.0, 0.2], 'odometry_source': 'encoders', 'wheel_radius': 0.1}
    assert options(file, '--wheel-separation', '0.4') == BagOptions(
        odometry_source='encoders', laser_pose=Pose.from_array((0.1, 0.0, 0.2)),
        wheel_radius=0.1, wheel_separation=0.4)
    assert options(file, '--odometry-source', 'tf', '--laser-pose', '0,0,0') == BagOptions(
        odometry_source='tf', laser_pose=Pose(0.0, 0.0, 0.0))
    assert options(read_parameters([ROOT / 'config' / 'slam.yaml'])) == BagOptions()


def test_what_ros_takes_in_a_parameter_file_is_taken(tmp_path: Path) -> None:
    path = tmp_path / 'mine.yaml'
    path.write_text('slam_node:\n  ros__parameters:\n    use_sim_time: true\n'
                    '    start_type_description_service: false\n'
                    '    qos_overrides: {/scan: {subscription: {depth: 5}}}\n'
                    '    qos_overrides./odom.subscription.depth: 5\n    resolution: 0.1\n')
    assert make(SlamConfig, read_parameters([path])).resolution == 0.1


def test_blocks_of_other_nodes_are_passed_over(tmp_path: Path) -> None:
    """One file for all nodes of a robot, as Nav2 has it, serves the commands as well."""
    path = tmp_path / 'nav2.yaml'
    path.write_text('robot1:\n  amcl:\n    ros__parameters: {alpha1: 0.1}\n'
                    '  slam_node:\n    ros__parameters: {resolution: 0.1}\n'
                    '/**/fusion_node:\n  ros__parameters: {estimation_confidence: 0.8}\n')
    assert read_parameters([path]) == {'resolution': 0.1, 'estimation_confidence': 0.8}


@pytest.fixture
def heeded() -> Iterator[None]:
    """Take SIGINT as a terminal's commands do: in the background of a script it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures('heeded')
def test_an_interrupt_is_one_line_also_while_a_command_is_being_imported(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr('somfusion_ros.cli.main.parser', lambda: signal.raise_signal(stop))
    for stop in (signal.SIGINT, signal.SIGTERM):
        assert main([]) == 130
        assert capsys.readouterr() == ('', 'somfusion: interrupted\n')
    light = 'import sys, somfusion_ros.cli.main; sys.exit("numpy" in sys.modules)'
    assert subprocess.run([sys.executable, '-c', light], check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.usefixtures('heeded')     # a process inherits what is ignored
@pytest.mark.parametrize('whole_group', [True, False], ids=['Ctrl-C', 'kill'])
def test_an_interrupted_replay_leaves_one_line_and_no_process(whole_group: bool,
                                                              tmp_path: Path) -> None:
    for name in ('a', 'b'):
        write_fake_bag(tmp_path / name)
    process = subprocess.Popen(
        [*COMMAND, 'replay', 'a', 'b', '--output', 'out', '--jobs', '2'], cwd=tmp_path,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        env=ENVIRONMENT)
    children = Path(f'/proc/{process.pid}/task/{process.pid}/children')
    begin = time.monotonic()
    while len(children.read_text().split()) < 3 and patient(30.0, begin):   # and their tracker
        time.sleep(0.01)
    if whole_group:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.terminate()
    said = process.communicate(timeout=30)   # so long as a process lives, the pipe stays open
    assert (process.returncode, *said) == (130, '', 'somfusion: interrupted\n')


def test_nodes_say_in_one_line_that_ros_is_missing() -> None:
    """As after `pip install .`; of this package's own faults, the traceback is kept."""
    code = """
import sys
from importlib import abc
class NoRos(abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('rclpy', 'builtin_interfaces', 'geometry_msgs'):
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)
sys.meta_path.insert(0, NoRos())
from somfusion_ros.ros import start
sys.argv, node = ['bin/node', *sys.argv[2:]], sys.argv[1]
sys.exit(getattr(start, node)())
"""

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, '-c', code, *arguments],
                              capture_output=True, text=True, timeout=60, env=ENVIRONMENT)

    for which in ('slam_node', 'fusion_node', 'player', 'watch'):
        helped, done = run(which, '--help'), run(which)
        assert (helped.returncode, helped.stderr) == (0, '')
        assert helped.stdout.startswith('usage: ')
        assert done.returncode == 1
        assert len(done.stderr.splitlines()) == 1
        assert done.stderr.startswith('node: No module named ')
        assert 'source ROS 2 Jazzy' in done.stderr


@pytest.mark.parametrize('text, message', [
    ('resolution: 0.1', 'not a ROS 2 parameter file'),
    ('- 1', 'not a ROS 2 parameter file'),
    ('/**: {ros__parameters: {resolutoin: 0.1}}', "no parameter 'resolutoin'"),
    ('/**: {ros__parameters: text}', 'not a ROS 2 parameter file'),
    ('a: &a {b: *a}', 'not a ROS 2 parameter file'),
    ('{}', 'not a ROS 2 parameter file'),
    ('amcl: {ros__parameters: {alpha1: 0.1}}', 'no block .* only for amcl'),
])
def test_bad_parameter_file(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / 'bad.yaml'
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_parameters([path])
    assert str(path) in str(error.value)


@pytest.mark.parametrize('wrong', [
    'resolution: 100.0', 'odometry_source: wheels', 'laser_pose: [1.0]', 'peers: [1]',
    'initial_poses: [robot1 1 2]', 'use_peers: 1', 'seeds: 1.5', 'method: sam',
    'map_update_interval: .nan', 'robot_name: a b', 'map_topic: a!', 'peers: robot-2',
    'scan_topics: "front/scan, b!"', 'world_anchor: 2nd', 'mode: localization',
    'resolution: true', 'robot_map_topic: map/', 'merged_map_topic: ""', 'scan_topics: scan/',
    'robot_name: küche', 'map_topic: a//b', 'map_frame: ""', 'odom_frame: /'])
def test_a_bad_value_is_told_with_file_and_node(tmp_path: Path, wrong: str) -> None:
    """Also of a parameter that the command does not use: the node would not start with it."""
    good, bad = tmp_path / 'good.yaml', tmp_path / 'bad.yaml'
    good.write_text('/**: {ros__parameters: {resolution: 1}}')
    bad.write_text(f'/**/slam_node: {{ros__parameters: {{{wrong}}}}}')
    with pytest.raises(InputError) as error:
        read_parameters([good, bad])
    assert str(error.value).startswith(f'{bad} (/**/slam_node): {wrong.partition(":")[0]} ')
    assert len(str(error.value).splitlines()) == 1


def test_values_that_contradict_one_another_are_told_with_the_file(tmp_path: Path) -> None:
    """The one that is named may be a default, which stands in no file."""
    path = tmp_path / 'two.yaml'
    path.write_text('/**: {ros__parameters: {scan_topics: a b, mount_source: laser_pose}}')
    with pytest.raises(InputError, match=f'^{path}: laser_pose is the mount of one laser'):
        read_parameters([path])


def test_names_of_robots_and_topics_are_taken() -> None:
    values = {'robot_name': 'fleet/robot7', 'robot_map_topic': '~/map', 'merged_map_topic': '/all',
              'peers': 'robot2, fleet/robot3', 'map_topic': ''}
    assert make(FusionNodeConfig, values).peers == ('robot2', 'fleet/robot3')
    assert make(SlamNodeConfig, {'map_frame': '/map'}).map_frame == 'map', 'as tf2 has it'
    assert make(SlamNodeConfig, {'scan_topics': ['front/scan back/scan']}).scan_topics == (
        'front/scan', 'back/scan')


@pytest.mark.parametrize('value', ['fine', 0.0, -1, True, float('nan')])
def test_bad_parameter_value(value: object) -> None:
    with pytest.raises(ValueError, match='resolution'):
        make(SlamConfig, {'resolution': value})
