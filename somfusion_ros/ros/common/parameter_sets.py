# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which node has which parameters, by title of their group."""

from dataclasses import fields

from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.node_config import FusionNodeConfig, SlamNodeConfig
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.team.config import TeamConfig

SETS: dict[str, dict[str, type]] = {
    'slam_node': {
        'The node: frames, times, odometry, files': SlamNodeConfig,
        'SLAM: scans, views, loops, map': SlamConfig},
    'fusion_node': {
        'The node: names, topics, rates, files': FusionNodeConfig,
        'The team: when pairs are matched, start poses, bodies': TeamConfig,
        'The merge of two maps: method, confidence, detail': FusionConfig}}


def names_of(node: str) -> set[str]:
    """Return the names of all parameters of a node."""
    return {item.name for config in SETS[node].values() for item in fields(config)}
