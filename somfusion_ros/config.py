# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter, once: default, unit, range and one sentence.

The nodes declare their ROS parameters from these dataclasses, and the YAML files in `config/`
repeat them with the same words (a test compares them).
"""

from dataclasses import dataclass, field, fields
from typing import Any


def parameter(default: Any, unit: str, low: float | None, high: float | None,
              description: str, live: bool = False) -> Any:
    """
    Make a dataclass field that carries its unit, range (None: open) and sentence.

    live: a node takes changes of it while it runs, even where its class is read at the start.
    """
    return field(default=default, metadata={
        'unit': unit, 'low': low, 'high': high, 'description': description, 'live': live})


def validate(config: Any) -> None:
    """Raise ValueError, naming the parameter, if a number leaves its range."""
    for item in fields(config):
        value, low, high = getattr(config, item.name), item.metadata['low'], item.metadata['high']
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        if (low is not None and not value >= low) or (high is not None and not value <= high):
            raise ValueError(f'{item.name} = {value} is outside [{low}, {high}]')


@dataclass(frozen=True)
class SlamConfig:
    """Parameters of one robot's SLAM."""

    resolution: float = parameter(
        0.05, 'm', 0.005, 1.0, 'Edge of a map cell; smaller is finer and costs memory.')
    max_laser_range: float = parameter(
        30.0, 'm', 0.1, 1000.0, 'Returns beyond this range are not used.')
    minimum_travel_distance: float = parameter(
        0.4, 'm', 0.01, 10.0, 'A new view is kept after this travel; fewer views cost less.')
    minimum_travel_heading: float = parameter(
        0.4, 'rad', 0.01, 3.2, 'A new view is kept after this turn.')
    map_scan_distance: float = parameter(
        0.1, 'm, rad', 0.0, 10.0,
        'Between views, a scan is drawn into the map after this travel or turn.')
    local_map_views: int = parameter(
        10, 'views', 1, 100, 'Scans are matched against the surface that this many views saw.')
    minimum_inlier_ratio: float = parameter(
        0.35, 'share', 0.0, 1.0, 'A match that explains less of the scan is not used.')
    doubtful_inlier_ratio: float = parameter(
        0.6, 'share', 0.0, 1.0,
        'Below this share of the scan, a match is checked by a wider correlative search.')
    loop_minimum_gap: int = parameter(
        15, 'views', 2, 1000, 'A loop joins views at least this many views apart.')
    loop_search_distance: float = parameter(
        2.5, 'm', 0.0, 100.0,
        'Loops are sought with old views whose surface lies this near, plus the uncertainty.')
    loop_minimum_overlap: float = parameter(
        0.3, 'share', 0.0, 1.0, 'A loop that covers less of what was seen is not used.')
    loop_minimum_agreement: float = parameter(
        0.75, 'share', 0.0, 1.0,
        'A loop is not used if fewer points than this fall on the old surface, among those that '
        'fall on it or in space seen to be free.')
    relinearise_distance: float = parameter(
        0.2, 'm', 0.0, 100.0,
        'The whole problem is solved anew once loops moved the poses this far in sum.')

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True)
class FusionConfig:
    """Parameters of the merge of two maps."""

    method: str = parameter(
        'som', '', None, None,
        'som: many hypotheses and a calibrated verdict; paper: the literal IROS 2011 method.')
    estimation_confidence: float = parameter(
        0.8, 'probability', 0.0, 1.0,
        'A relative pose is accepted at this probability of being right.')
    segment_radius: float = parameter(
        0.15, 'm', 0.01, 2.0,
        'Wall cells at most this far apart are one segment; raise it for sparse scans.')
    cluster_spacing: float = parameter(
        0.4, 'm', 0.05, 5.0,
        'Distance of neighbouring clusters along a wall; smaller is finer and slower.')
    presentation_step: float = parameter(
        0.1, 'evidence', 0.01, 1.0,
        'A wall cell is presented |C| / step times, so that sure cells pull more.')
    vote_cell: float = parameter(
        0.5, 'm', 0.1, 5.0, 'Edge of the cells in which cluster pairs vote for a shift.')
    seeds: int = parameter(
        14, 'seeds', 1, 200, 'Shifts that are tried for each hypothesis of the orientation.')
    finalists: int = parameter(
        8, 'poses', 2, 50, 'Distinct poses that are settled with all clusters and judged.')

    def __post_init__(self) -> None:
        validate(self)
        if self.method not in ('som', 'paper'):
            raise ValueError(f"method = '{self.method}' is neither 'som' nor 'paper'")


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
        'A scan waits this long for odometry that covers it, then it is dropped and counted; '
        'longer where odometry arrives late.')
    odometry_source: str = parameter(
        'odom', '', None, None,
        'odom: nav_msgs/Odometry on odom; encoders: two wheels in joint_states.')
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
    laser_pose: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0), 'm, m, rad', None, None,
        'Mount of the laser on the robot (x, y, yaw); all zero: taken from /tf_static.')
    map_directory: str = parameter(
        '.', '', None, None,
        'Folder into which save_map writes map.yaml and map.pgm.', live=True)
    state_file: str = parameter(
        '', '', None, None,
        'File from which a restarted node goes on with its map; empty begins a new map always.')
    state_interval: float = parameter(
        10.0, 's', 0.1, 3600.0,
        'Time between two writes of state_file; longer spares the disk, shorter loses less.')

    def __post_init__(self) -> None:
        validate(self)
        if self.odometry_source not in ('odom', 'encoders'):
            raise ValueError(
                f'odometry_source = {self.odometry_source!r} is neither odom nor encoders')
        if len(self.laser_pose) != 3:
            raise ValueError(f'laser_pose = {list(self.laser_pose)} must be x, y and yaw')


@dataclass(frozen=True)
class FusionNodeConfig:
    """Parameters of fusion_node beside those of the merge of two maps."""

    robot_name: str = parameter(
        '', '', None, None,
        'Name under which the other robots know this one; empty takes the namespace.')
    peers: tuple[str, ...] = parameter(
        ('',), '', None, None,
        'Names of the robots to merge with; empty merges with every robot that shows up.')
    robot_map_topic: str = parameter(
        'map', '', None, None,
        'Last name of the topic on which every robot publishes its own map.')
    merged_map_topic: str = parameter(
        'global_map', '', None, None,
        'Topic of the merged map.')
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
    estimation_rate: float = parameter(
        0.5, 'Hz', 0.01, 100.0,
        'A pair of robots is matched at most this often; lower it where CPU is scarce.')
    minimum_change: float = parameter(
        0.1, '', 0.0, 1.0,
        'A pair is matched again once this share of the walls of one map is new or gone.')
    plain_map_delay: float = parameter(
        10.0, 's', 0.0, 3600.0,
        'A robot with a map is given this time to show a fusion node, which tells little, before '
        'its whole maps are listened to.')
    known_init_poses: bool = parameter(
        False, '', None, None,
        'Trust initial_poses instead of matching maps; true where the start poses are surveyed.')
    initial_poses: tuple[str, ...] = parameter(
        ('',), 'm, m, rad', None, None,
        'Map frames in one common frame, each as "name x y yaw"; used with known_init_poses.')
    peer_timeout: float = parameter(
        30.0, 's', 1.0, 3600.0,
        'A peer whose map was not heard for this time is reported as silent.')
    robot_radius: float = parameter(
        0.35, 'm', 0.0, 10.0,
        "Walls within this distance of a robot's path, which its own map shows as free, are taken "
        'for its body; the radius of the largest robot and a cell more.')
    max_map_cells: int = parameter(
        67108864, 'cells', 1, 268435456,
        'Larger maps are refused and counted; raise it for very large or very fine maps.')
    map_directory: str = parameter(
        '.', '', None, None,
        'Folder into which save_map writes global_map.yaml and global_map.pgm.')

    def __post_init__(self) -> None:
        validate(self)
        self.known_poses()

    def known_poses(self) -> dict[str, tuple[float, float, float]]:
        """Parse initial_poses; ValueError names the one that is not `name x y yaw`."""
        poses = {}
        for text in filter(None, self.initial_poses):
            name, *numbers = text.split()
            try:
                x, y, theta = (float(number) for number in numbers)
            except ValueError as error:
                raise ValueError(f'initial_poses: {text!r} is not "name x y yaw"') from error
            poses[name] = (x, y, theta)
        return poses
