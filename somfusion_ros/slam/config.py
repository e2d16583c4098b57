# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of one robot's SLAM."""

from dataclasses import dataclass

from somfusion_ros.settings import parameter, validate

AUTO = 'auto'
BEAM_ORDERS = (AUTO, 'rising', 'falling', 'at_once')


@dataclass(frozen=True)
class SlamConfig:
    """Parameters of one robot's SLAM."""

    resolution: float = parameter(
        0.05, 'm', 0.005, 1.0, 'Edge of a map cell; smaller is finer and costs memory.')
    max_laser_range: float = parameter(
        30.0, 'm', 0.1, 1000.0, 'Returns beyond this range are not used.')
    beam_order: str = parameter(
        AUTO, '', None, None,
        'Order in time of the beams of a scan that has a time_increment: rising, falling (the '
        'driver turned the beams of a clockwise laser round), at_once (the driver undid the '
        'motion already); auto: learned while the robot turns, and as told until then.',
        among=BEAM_ORDERS)
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
