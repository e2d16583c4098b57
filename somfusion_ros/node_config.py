# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Parameters of the nodes beside those of the core.

No ROS is needed here: the commands read the same parameter files as the nodes.
"""

from collections.abc import Iterable
from dataclasses import dataclass
import re

from somfusion_ros.settings import parameter, SettingError, validate

ODOMETRY_SOURCES = ('auto', 'odom', 'encoders', 'tf', 'none')
MOUNT_SOURCES = ('auto', 'tf', 'laser_pose')
MODES = ('mapping', 'localization')


@dataclass(frozen=True)
class SlamNodeConfig:
    """Parameters of slam_node beside those of SLAM itself."""

    odom_frame: str = parameter(
        'odom', '', None, None,
        'Frame in which the odometry places the robot; prefix it where all robots share one /tf.')
    map_frame: str = parameter(
        'map', '', None, None,
        'Frame of the map; prefix it where all robots share one /tf.')
    base_frame: str = parameter(
        'base_link', '', None, None,
        'Frame of the robot, from which the mount of the laser is looked up.')
    map_update_interval: float = parameter(
        5.0, 's', 0.1, 3600.0,
        'Time between two published maps; shorter shows more, longer saves CPU and network.',
        live=True)
    transform_publish_period: float = parameter(
        0.05, 's', 0.0, 60.0,
        'Time between two map -> odom transforms; 0 publishes none.')
    transform_timeout: float = parameter(
        0.5, 's', 0.0, 60.0,
        'Where odometry stalls for this long, its motion goes on for up to half a second; later '
        'scans wait for odometry that comes late, for up to 6 s.')
    odometry_source: str = parameter(
        'auto', '', None, None,
        'odom: nav_msgs/Odometry on odom; encoders: two wheels in joint_states; tf: the transform '
        'odom -> base_link on /tf; none: the motion is guessed from the scans alone; auto: odom, '
        'or tf where only that is heard.', among=ODOMETRY_SOURCES)
    wheel_radius: float = parameter(
        0.077, 'm', 0.001, 10.0,
        'Radius of the two driven wheels; used only with odometry_source encoders.')
    wheel_separation: float = parameter(
        0.33, 'm', 0.001, 10.0,
        'Distance of the two driven wheels; used only with odometry_source encoders.')
    left_wheel_joint: str = parameter(
        'left_wheel_joint', '', None, None,
        'Name of the left wheel in joint_states; used only with odometry_source encoders.')
    right_wheel_joint: str = parameter(
        'right_wheel_joint', '', None, None,
        'Name of the right wheel in joint_states; used only with odometry_source encoders.')
    peer_radius: float = parameter(
        0.5, 'm', 0.0, 10.0,
        "Returns within this distance of another robot's centre are not used, where fusion_node "
        'tells its place; its radius and how far it moves in a moment. 0 uses all returns.')
    scan_topics: tuple[str, ...] = parameter(
        ('scan',), '', None, None,
        'Topics of the laser scans, as a list or as one text with blanks or commas between them; '
        'several for several lasers on one robot, each with a mount on /tf_static. LaserScan, '
        'MultiEchoLaserScan and PointCloud2 are read.', words=True, name='topic')
    use_peers: bool = parameter(
        False, '', None, None,
        "Show map, pose and path as the team's views straighten them, where fusion_node runs; the "
        "robot's own estimate, and what is told of it, stay as they are.")
    laser_pose: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'm, m, rad', None, None,
        'Mount of the laser on the robot (x, y, yaw); where it is used, see mount_source.')
    mount_source: str = parameter(
        'auto', '', None, None,
        'Where the mount of the laser comes from: tf: /tf_static; laser_pose: that parameter, '
        'also where it is all zero; auto: laser_pose unless it is all zero, else tf.',
        among=MOUNT_SOURCES)
    mode: str = parameter(
        'mapping', '', None, None,
        'mapping: a map is made; localization: the robot is tracked in the map of map_file or '
        'map_topic, which stays as it is.', among=MODES)
    map_file: str = parameter(
        '', '', None, None,
        'Map to localise in: a map.yaml as of map_server, or what serialize_map wrote; used with '
        'mode localization.')
    map_topic: str = parameter(
        '', '', None, None,
        'Topic of a map to localise in, where map_file is empty, for instance the global_map of '
        'another robot: the first map that comes is taken; used with mode localization.',
        name='topic')
    map_directory: str = parameter(
        '.', '', None, None,
        'Folder of the files that save_map and serialize_map write; ~ is the home folder.',
        live=True)
    map_name: str = parameter(
        '', '', None, None,
        'Name, without ending, of the files that save_map, serialize_map and deserialize_map use; '
        'it may be a path. Empty takes the namespace: robot1_map.', live=True)
    autostart: bool = parameter(
        True, '', None, None,
        'Configure and activate at the start; false where a lifecycle_manager does it.')
    state_file: str = parameter(
        '', '', None, None,
        'File from which a restarted node goes on with its map; empty begins a new map always.')
    state_interval: float = parameter(
        10.0, 's', 0.1, 3600.0,
        'Time between two writes of state_file; longer spares the disk, shorter loses less.')

    def __post_init__(self) -> None:
        validate(self)
        _strip_frames(self, 'odom_frame', 'map_frame', 'base_frame')
        if self.mode == 'localization' and not (self.map_file or self.map_topic):
            raise SettingError('mode', 'localization needs a map: set map_file or map_topic')
        if len(self.laser_pose) != 3:
            raise SettingError('laser_pose', f'= {list(self.laser_pose)} must be x, y and yaw')
        object.__setattr__(self, 'scan_topics', split_words(self.scan_topics) or ('scan',))
        if len(self.scan_topics) > 1 and self.given_mount is not None:
            raise SettingError('laser_pose', 'is the mount of one laser, but scan_topics names '
                               f'{len(self.scan_topics)}: their mounts must be on /tf_static')

    @property
    def given_mount(self) -> tuple[float, ...] | None:
        """Mount of the laser (x, y, yaw) that is to be used; None where TF tells it."""
        used = self.mount_source == 'laser_pose' or (
            self.mount_source == 'auto' and any(self.laser_pose))
        return self.laser_pose if used else None


@dataclass(frozen=True)
class FusionNodeConfig:
    """Parameters of fusion_node beside those of the merge of two maps."""

    robot_name: str = parameter(
        '', '', None, None,
        'Name under which the other robots know this one; empty takes the namespace.',
        name='robot')
    peers: tuple[str, ...] = parameter(
        ('',), '', None, None,
        'Names of the robots to merge with, as a list or as one text with blanks or commas '
        'between them; empty merges with every robot that shows up.', words=True, name='robot')
    robot_map_topic: str = parameter(
        'map', '', None, None,
        'Last name of the topic on which every robot publishes its own map.', name='topic')
    merged_map_topic: str = parameter(
        'global_map', '', None, None,
        'Topic of the merged map.', name='topic')
    world_frame: str = parameter(
        'world', '', None, None,
        'Frame that all robots of a connected team share; prefix it where they share one /tf.')
    map_frame: str = parameter(
        'map', '', None, None,
        "Frame of the robot's own map; prefix it where all robots share one /tf.")
    merging_rate: float = parameter(
        1.0, 'Hz', 0.01, 100.0,
        'The merged map, transforms and poses are published at most this often.')
    discovery_rate: float = parameter(
        0.5, 'Hz', 0.01, 100.0,
        'How often new robots are looked for.')
    plain_map_delay: float = parameter(
        10.0, 's', 0.0, 3600.0,
        'A robot with a map is given this time to show a fusion node, which tells little, before '
        'its whole maps are listened to.')
    peer_timeout: float = parameter(
        30.0, 's', 1.0, 3600.0,
        'A peer whose map was not heard for this time is reported as silent.')
    max_map_cells: int = parameter(
        67108864, 'cells', 1, 268435456,
        'Larger maps are refused and counted; raise it for very large or very fine maps.')
    transform_publish_period: float = parameter(
        0.05, 's', 0.0, 60.0,
        'Time between two world -> map transforms, as slam_node repeats map -> odom; 0 publishes '
        'none.')
    transform_timeout: float = parameter(
        0.5, 's', 0.0, 60.0,
        'Transforms are dated this far ahead, so that whoever asks for the present finds one.')
    map_update_interval: float = parameter(
        5.0, 's', 0.1, 3600.0,
        'A merged map that did not change is published again after this time, for subscribers '
        'that came late and take no latched message.', live=True)
    map_directory: str = parameter(
        '.', '', None, None,
        'Folder of the files that save_map writes; ~ is the home folder.', live=True)
    map_name: str = parameter(
        '', '', None, None,
        'Name, without ending, of the files that save_map writes; it may be a path. Empty takes '
        'the namespace: robot1_global_map.', live=True)
    autostart: bool = parameter(
        True, '', None, None,
        'Configure and activate at the start; false where a lifecycle_manager does it.')

    def __post_init__(self) -> None:
        validate(self)
        _strip_frames(self, 'world_frame', 'map_frame')
        object.__setattr__(self, 'peers', split_words(self.peers) or ('',))


def _strip_frames(config: SlamNodeConfig | FusionNodeConfig, *names: str) -> None:
    """Take the first slash off names of frames, as tf2 does; SettingError if nothing is left."""
    for name in names:
        frame = getattr(config, name).strip().lstrip('/')
        if not frame:
            raise SettingError(name, f'= {getattr(config, name)!r} must be the name of a frame')
        object.__setattr__(config, name, frame)


def split_words(texts: Iterable[str]) -> tuple[str, ...]:
    """Return the words, once each, of texts with blanks or commas between them."""
    return tuple(dict.fromkeys(
        word for text in texts for word in re.split(r'[\s,]+', text) if word))
