# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits on the robot, from the transforms of a bag."""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from somfusion_ros.geometry import Array, Pose
from somfusion_ros.tools.bag_reader import BagReader

BASE_FRAMES = ('base_link', 'base_footprint', 'base')
TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')
LARGEST_TILT = np.radians(10.0)   # a plane tilted more does not see the walls of one floor plan
SCANNED_FOR_STATIC = 2000         # messages of /tf looked through where tf_static has no chain


@dataclass(frozen=True)
class Mount:
    """T_base_laser of the scan plane, and whether the laser looks at it from below."""

    T_base_laser: Pose
    upside_down: bool


def plain(frame: str) -> str:
    """Frame name without the leading slash of old logs."""
    return frame.lstrip('/')


def yaw(quaternion: Any) -> float:
    """Heading [rad] of a geometry_msgs/Quaternion."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return float(np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z))


def find_mount(reader: BagReader, base_frame: str, laser_frame: str) -> Mount | None:
    """
    Compose the chain of transforms from base to laser; None where there is no chain.

    The usual names of the base stand in for one another: encoders name no frame, and a chain
    often begins at base_link where the odometry speaks of base_footprint right below.
    """
    if laser_frame == base_frame:
        return Mount(Pose(), False)
    prefix = base_frame.rpartition('/')[0]
    bases = [base_frame, *(f'{prefix}/{name}'.lstrip('/') for name in BASE_FRAMES)]
    edges: dict[tuple[str, str], Array] = {}
    topics = reader.topics(*TF_TYPES)
    for topic in sorted(topics, key=lambda t: 'static' not in t):
        for number, (_, _, message) in enumerate(reader.messages({topic})):
            if number >= SCANNED_FOR_STATIC and 'static' not in topic:
                break
            _collect(message, edges)
        for base in bases:
            T = _chain(edges, base, laser_frame)
            if T is not None:
                return _planar(reader, T, laser_frame)
    return None


def _collect(message: Any, edges: dict[tuple[str, str], Array]) -> None:
    """Add the transforms of a message; odometry and localisation move and are left out."""
    for item in message.transforms:
        parent, child = plain(item.header.frame_id), plain(item.child_frame_id)
        if parent.rpartition('/')[2] in ('odom', 'map', 'world'):
            continue
        T = _matrix(item.transform)
        if np.isfinite(T).all():
            edges.setdefault((parent, child), T)


def _chain(edges: dict[tuple[str, str], Array], start: str, goal: str) -> Array | None:
    """Compose the shortest chain of transforms, taken forwards or backwards, breadth first."""
    both = dict(edges)
    both.update({(b, a): np.linalg.inv(T) for (a, b), T in edges.items() if (b, a) not in edges})
    reached, queue = {start: np.eye(4)}, deque([start])
    while queue:
        frame = queue.popleft()
        for (a, b), T in both.items():
            if a == frame and b not in reached:
                reached[b] = reached[a] @ T
                queue.append(b)
    return reached.get(goal)


def _matrix(transform: Any) -> Array:
    """Homogeneous matrix (4, 4) of a geometry_msgs/Transform; NaN where it is no rotation."""
    t, q = transform.translation, transform.rotation
    values = np.array([q.x, q.y, q.z, q.w], dtype=float)
    norm = np.linalg.norm(values)
    x, y, z, w = values / norm if norm > 1e-6 else np.full(4, np.nan)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), t.x],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), t.y],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), t.z],
        [0.0, 0.0, 0.0, 1.0]])


def _planar(reader: BagReader, T: Array, laser_frame: str) -> Mount:
    """Project a mount into the plane; BagError where the laser does not scan the plane."""
    tilt = np.arccos(np.clip(abs(T[2, 2]), 0.0, 1.0))
    if tilt > LARGEST_TILT:
        raise reader.error(f'laser {laser_frame!r} is tilted by {np.degrees(tilt):.0f} deg; '
                           'only level lasers can be used')
    theta = float(np.arctan2(T[1, 0], T[0, 0]))
    return Mount(Pose.from_array((T[0, 3], T[1, 3], theta)), bool(T[2, 2] < 0.0))
