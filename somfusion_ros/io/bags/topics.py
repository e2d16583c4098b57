# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics and frames of a bag hold the scans and the odometry."""

from typing import Any

from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.bags.transforms import TF_TYPES
from somfusion_ros.io.frame_tree import BASE_FRAMES, plain

SCAN = 'sensor_msgs/msg/LaserScan'
ODOMETRY = 'nav_msgs/msg/Odometry'
JOINTS = 'sensor_msgs/msg/JointState'
SOURCES = ('auto', 'odom', 'encoders', 'tf')


def stamp(header: Any, log_time: float) -> float:
    """Stamp [s] of a header; the time of recording where the header has none."""
    seconds = header.stamp.sec + header.stamp.nanosec * 1e-9
    return seconds if seconds != 0 else log_time


def choose_scan_topic(reader: BagReader, wanted: str | None) -> str:
    """Find the topic of the laser scans."""
    return _choose(reader, SCAN, 'laser scans', wanted, 'scan', '--scan-topic')


def choose_odometry(reader: BagReader, options: BagOptions) -> tuple[str, str]:
    """Find source (odom, encoders or tf) and topic of the odometry."""
    source = options.odometry_source
    if source not in SOURCES:
        raise ValueError(f'odometry source {source!r} is none of {", ".join(SOURCES)}')
    if source == 'auto':
        source = _best_source(reader, options)
    if source == 'odom':
        return source, _choose(reader, ODOMETRY, 'odometry', options.odom_topic, 'odom',
                               '--odom-topic')
    if source == 'encoders':
        if options.wheel_radius is None or options.wheel_separation is None:
            raise reader.error('odometry from encoders needs --wheel-radius and '
                               '--wheel-separation')
        return source, _choose(reader, JOINTS, 'joint states (wheel encoders)', None,
                               'joint_states', '--odometry-source')
    return source, _choose(reader, TF_TYPES, 'odometry (no odom topic, no /tf)', None, 'tf',
                           '--odometry-source')


def _best_source(reader: BagReader, options: BagOptions) -> str:
    """Prefer an odometry topic, then encoders whose wheels are known, then /tf."""
    if options.odom_topic is not None or reader.topics(ODOMETRY):
        return 'odom'
    encoders = bool(reader.topics(JOINTS))
    if encoders and options.wheel_radius and options.wheel_separation:
        return 'encoders'
    if any(odometry_frames(message) for topic in reader.topics(*TF_TYPES) if 'static' not in topic
           for _, _, message in _some(reader, topic)):
        return 'tf'
    hint = '; it has joint states: give --wheel-radius and --wheel-separation' if encoders else ''
    raise reader.error(f'no odometry (no {ODOMETRY} topic, no odom frame in /tf){hint}')


def _some(reader: BagReader, topic: str, limit: int = 500) -> Any:
    """Yield the first messages of a topic."""
    return (item for _, item in zip(range(limit), reader.messages({topic})))


def odometry_frames(message: Any) -> tuple[str, str] | None:
    """Odometry and base frame of the transform of a TFMessage that holds odometry, if any."""
    for transform in message.transforms:
        parent, child = plain(transform.header.frame_id), plain(transform.child_frame_id)
        if parent.rpartition('/')[2] == 'odom':
            return parent, child
    return None


def base_frame(reader: BagReader, source: str, topic: str) -> str:
    """Name of the frame whose motion the odometry tells."""
    if source == 'odom':
        return plain(reader.first(topic).child_frame_id) or BASE_FRAMES[0]
    if source == 'tf':
        for _, _, message in reader.messages({topic}):
            frames = odometry_frames(message)
            if frames:
                return frames[1]
        raise reader.error(f'no odometry (no odom frame in {topic})')
    return BASE_FRAMES[0]


def _choose(reader: BagReader, types: str | tuple[str, ...], what: str, wanted: str | None,
            usual: str, option: str) -> str:
    """Choose the one topic of a type; the usual name wins, a choice is never guessed."""
    found = reader.topics(*((types,) if isinstance(types, str) else types))
    if wanted is not None:
        matches = [t for t in found if t.lstrip('/') == wanted.lstrip('/')]
        if not matches:
            raise reader.error(f'no {what} on topic {wanted} '
                               f'(found: {", ".join(found) or "none"})')
        return matches[0]
    named = [t for t in found if t.rpartition('/')[2] == usual]
    exact = [t for t in named if t.lstrip('/') == usual]
    for candidates in (exact, named, found):
        if len(candidates) == 1:
            return candidates[0]
    if not found:
        raise reader.error(f'no {what}')
    raise reader.error(f'several topics with {what}: {", ".join(found)}; name one by {option}')
