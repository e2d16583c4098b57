# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which topics and frames of a bag hold the scans and the odometry of a robot."""

from dataclasses import dataclass, replace
from typing import Any

from somfusion_ros.io.bags.options import BagOptions
from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.bags.transforms import in_namespace, odometry_frames, TF_TYPES
from somfusion_ros.io.frame_names import BASE_FRAMES, plain
from somfusion_ros.node_config import ODOMETRY_SOURCES

SCANS = ('sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/MultiEchoLaserScan')
CLOUD = 'sensor_msgs/msg/PointCloud2'
IMU = 'sensor_msgs/msg/Imu'
ODOMETRY = 'nav_msgs/msg/Odometry'
JOINTS = 'sensor_msgs/msg/JointState'
NO_ODOMETRY = f'no odometry (no {ODOMETRY} topic, no odom frame in /tf)'
MOST_NAMED = 8   # topics in a message


@dataclass(frozen=True)
class OdometrySource:
    """
    Where a robot's odometry comes from: kind (odom, encoders, tf, none), topic, and frames.

    base_frame is the frame whose motion it tells; frames (parent, child) those of /tf; gyro is the
    topic of a gyroscope beside it, '' where there is none, or several.
    """

    kind: str
    topic: str
    base_frame: str
    frames: tuple[str, str] | None = None
    gyro: str = ''


def stamp(header: Any, log_time: float) -> float:
    """Return the stamp [s] of a header; the time of recording where the header has none."""
    seconds = float(header.stamp.sec + header.stamp.nanosec * 1e-9)
    return seconds if seconds != 0 else log_time


def is_stamped(message: Any) -> bool:
    """Tell whether a message has a stamp, or no header of its own."""
    header = getattr(message, 'header', None)
    return header is None or bool(header.stamp.sec or header.stamp.nanosec)


def laser_frames(reader: BagReader) -> dict[str, str]:
    """Return the frame of the first scan on every topic that holds scans."""
    return {topic: plain(reader.first(topic).header.frame_id)
            for topic in reader.topics(*SCANS, CLOUD)}


def find_robots(reader: BagReader) -> list[str]:
    """
    Find the namespaces of the robots in a bag; [''] where it is one robot's.

    Of several robots each has scans in a namespace, and odometry there, or in transforms that
    carry its name.
    """
    moving = [topic for topic in reader.topics(ODOMETRY, JOINTS, *TF_TYPES)
              if 'static' not in topic]
    robots = set()
    for topic in reader.topics(*SCANS) or reader.topics(CLOUD):
        parts = topic.strip('/').split('/')[:-1]
        names = ['/'.join(parts[:n]) for n in range(len(parts), 0, -1)]
        robots |= set(next(([name] for name in names
                            if any(in_namespace(t, name) for t in moving)), names[-1:]))
    if len(robots) > 1:
        robots = {name for name in robots if any(in_namespace(t, name) for t in moving)
                  or _has_own_frames(reader, name)}
    return sorted(robots) if len(robots) > 1 else ['']


def choose_scan_topics(reader: BagReader, options: BagOptions) -> list[str]:
    """
    Find the topics of the laser scans: one, or those of several lasers on one robot.

    Clouds are taken where they are asked for, or where there is nothing else.
    """
    wanted, found = options.scan_topic, _found(reader, SCANS, options.namespace)
    clouds = _found(reader, (CLOUD,), options.namespace)
    if clouds and (not found or wanted is not None and _matches(
            clouds, wanted, options.namespace) and not _matches(found, wanted, options.namespace)):
        return [_choose(reader, (CLOUD,), 'clouds', wanted, 'points', '--scan-topic',
                        options.namespace)]
    if wanted is None and len(found) > 1 and not _named(found, 'scan', options.namespace):
        frames = {topic: plain(reader.first(topic).header.frame_id) for topic in found}
        if len(set(frames.values())) == len(found):
            return found
    return [_choose(reader, SCANS, 'laser scans', wanted, 'scan', '--scan-topic',
                    options.namespace)]


def choose_odometry(reader: BagReader, options: BagOptions) -> OdometrySource:
    """Find where the odometry of a robot comes from, and the one gyroscope beside it."""
    gyros = _found(reader, (IMU,), options.namespace)
    return replace(_odometry(reader, options), gyro=gyros[0] if len(gyros) == 1 else '')


def _odometry(reader: BagReader, options: BagOptions) -> OdometrySource:
    """Find where the odometry of a robot comes from."""
    kind, namespace = options.odometry_source, options.namespace
    if kind not in ODOMETRY_SOURCES:
        raise ValueError(f'odometry source {kind!r} is none of {", ".join(ODOMETRY_SOURCES)}')
    if options.odom_topic is not None and kind not in ('auto', 'odom'):
        raise reader.error(f'--odom-topic {options.odom_topic} is not used with odometry source '
                           f'{kind}: leave out one of them')
    in_tf = None
    if kind == 'auto':
        kind, in_tf = _best_source(reader, options)
    if kind == 'none':
        return OdometrySource('none', '', BASE_FRAMES[0])
    if kind == 'odom':
        topic = _choose(reader, (ODOMETRY,), 'odometry', options.odom_topic, 'odom',
                        '--odom-topic', namespace)
        frame = plain(reader.first(topic).child_frame_id)
        return OdometrySource(kind, topic, frame or BASE_FRAMES[0])
    if kind == 'encoders':
        if options.wheel_radius is None or options.wheel_separation is None:
            raise reader.error('odometry from encoders needs --wheel-radius and '
                               '--wheel-separation')
        topic = _choose(reader, (JOINTS,), 'joint states (wheel encoders)', None, 'joint_states',
                        '--odometry-source', namespace)
        return OdometrySource(kind, topic, BASE_FRAMES[0])
    in_tf = in_tf or odometry_frames(reader, namespace)
    if in_tf is None:
        raise reader.error('no odometry (no odom frame in /tf)')
    return OdometrySource('tf', in_tf[0], in_tf[1][1], in_tf[1])


def _best_source(reader: BagReader, options: BagOptions
                 ) -> tuple[str, tuple[str, tuple[str, str]] | None]:
    """Prefer an odometry topic, then encoders whose wheels are known, then /tf, then none."""
    if options.odom_topic is not None or _found(reader, (ODOMETRY,), options.namespace):
        return 'odom', None
    encoders = bool(_found(reader, (JOINTS,), options.namespace))
    if encoders and options.wheel_radius and options.wheel_separation:
        return 'encoders', None
    in_tf = odometry_frames(reader, options.namespace)
    if in_tf is not None:
        return 'tf', in_tf
    if encoders:
        raise reader.error(f'{NO_ODOMETRY}; it has joint states: give --wheel-radius and '
                           '--wheel-separation; to map without any, give --odometry-source none')
    return 'none', None


def _has_own_frames(reader: BagReader, name: str) -> bool:
    """Tell whether frames of the transforms that all robots share have a robot's prefix."""
    found = odometry_frames(reader, name)
    return found is not None and any(
        frame.startswith((f'{name}/', f'{name}_')) for frame in found[1])


def _found(reader: BagReader, types: tuple[str, ...], namespace: str) -> list[str]:
    """Return the topics of some types in a namespace."""
    return [topic for topic in reader.topics(*types) if in_namespace(topic, namespace)]


def _named(found: list[str], usual: str, namespace: str) -> str | None:
    """Return the one topic that has the usual name; None where none or several have."""
    named = [t for t in found if t.rpartition('/')[2] == usual]
    exact = [t for t in named if t.strip('/') == f'{namespace}/{usual}'.strip('/')]
    return next((candidates[0] for candidates in (exact, named) if len(candidates) == 1), None)


def _matches(found: list[str], wanted: str, namespace: str) -> list[str]:
    """Return the topics that a name means, with or without the namespace."""
    names = (wanted.lstrip('/'), f'{namespace}/{wanted.lstrip("/")}')
    return [topic for topic in found if topic.lstrip('/') in names]


def _choose(reader: BagReader, types: tuple[str, ...], what: str, wanted: str | None,
            usual: str, option: str, namespace: str) -> str:
    """Choose the one topic of a type; the usual name wins, a choice is never guessed."""
    found = _found(reader, types, namespace)
    if wanted is not None:
        matches = _matches(found, wanted, namespace)
        if not matches:
            raise reader.error(f'no {what} on topic {wanted} '
                               f'(found: {", ".join(found) or "none"})')
        return matches[0]
    named = _named(found, usual, namespace)
    if named is not None or len(found) == 1:
        return named or found[0]
    if not found:
        where = f' in namespace {namespace}' if namespace else ''
        held = list(reader.types())
        more = ', ...' if len(held) > MOST_NAMED else ''
        raise reader.error(f'no {what}{where} (the bag holds '
                           f'{", ".join(sorted(held)[:MOST_NAMED]) or "no messages"}{more})')
    raise reader.error(f'several topics with {what}: {", ".join(found)}; name one by {option}')
