# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Why a slam_node hears nothing: who publishes what it listens to, and where such else is."""

from collections.abc import Collection, Sequence
from typing import Any

from somfusion_ros.io.bags.topics import JOINTS, ODOMETRY
from somfusion_ros.node_config import SlamNodeConfig
from somfusion_ros.ros.common import names
from somfusion_ros.ros.slam.scan_input import KINDS

MOST_NAMED = 3   # topics in a sentence
ODOMETRIES = ((names.ODOMETRY,), (ODOMETRY,), 'odometry is')
HEARD: dict[str, tuple[tuple[str, ...], tuple[str, ...], str]] = {
    'auto': ODOMETRIES, 'odom': ODOMETRIES,
    'encoders': ((names.JOINT_STATES,), (JOINTS,), 'joint states are')}


def hint(node: Any, config: SlamNodeConfig, kind: str) -> str:
    """Say why what a fault names is not heard; '' where that is not to be seen."""
    if kind == 'seconds_without_scan':
        return _publishers(node, config.scan_topics, KINDS, 'scans are')
    if kind != 'seconds_without_odometry' or config.odometry_source not in HEARD:
        return ''
    found = _publishers(node, *HEARD[config.odometry_source])
    if found and config.odometry_source != 'encoders' and node.count_publishers(
            names.JOINT_STATES):
        found += '; for wheel encoders on joint_states set odometry_source: encoders'
    return found


def _publishers(node: Any, topics: Sequence[str], types: Collection[str], what: str) -> str:
    """Say which topics nobody publishes, or as another type, and where such messages are."""
    resolved = [node.resolve_topic_name(topic) for topic in topics]
    told = {topic: {info.topic_type for info in node.get_publishers_info_by_topic(topic)}
            for topic in resolved}
    silent = [topic for topic in resolved if not told[topic]]
    other = [f'{topic} is {", ".join(sorted(told[topic]))}, which is not read'
             for topic in resolved if told[topic] and not told[topic] & set(types)]
    if other or not silent:
        return ''.join(f': {words}' for words in other[:1])
    own = f'{node.get_namespace().rstrip("/")}/'
    found = sorted((topic for topic, kinds in node.get_topic_names_and_types()
                    if set(kinds) & set(types) and topic not in resolved
                    and not topic.endswith(f'/{names.CLUSTERS}') and node.count_publishers(topic)),
                   key=lambda topic: (not topic.startswith(own), topic))
    where = f'; {what} on {", ".join(found[:MOST_NAMED])}' if found else ''
    return f': nobody publishes {", ".join(silent)}{where}'
