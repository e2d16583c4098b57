# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits on the robot: the tree of fixed transforms between base and laser."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, Pose

BASE_FRAMES = ('base_link', 'base_footprint', 'base')
MOVING = ('odom', 'map', 'world')   # parents of transforms that are no part of the robot
LARGEST_TILT = np.radians(10.0)   # a plane tilted more does not see the walls of one floor plan


@dataclass(frozen=True)
class Mount:
    """T_base_laser of the scan plane, and whether the laser looks at it from below."""

    T_base_laser: Pose
    upside_down: bool = False


class FrameTree:
    """Transforms that never change, by parent and child frame, from any number of messages."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], Array] = {}

    def add(self, transforms: Iterable[Any]) -> None:
        """Keep geometry_msgs/TransformStamped; what moves or is no rotation is left out."""
        for item in transforms:
            parent, child = plain(item.header.frame_id), plain(item.child_frame_id)
            if parent.rpartition('/')[2] in MOVING:
                continue
            T = _matrix(item.transform)
            if np.isfinite(T).all():
                self._edges.setdefault((parent, child), T)

    def mount(self, base_frame: str, laser_frame: str) -> Mount | None:
        """
        Compose the chain of transforms from base to laser; None where there is no chain.

        The usual names of the base stand in for one another: encoders name no frame, and a chain
        often begins at base_link where the odometry speaks of base_footprint right below.
        ValueError where the laser does not scan the plane.
        """
        base_frame, laser_frame = plain(base_frame), plain(laser_frame)
        if laser_frame == base_frame:
            return Mount(Pose())
        prefix = base_frame.rpartition('/')[0]
        for base in (base_frame, *(plain(f'{prefix}/{name}') for name in BASE_FRAMES)):
            T = self._chain(base, laser_frame)
            if T is not None:
                return _planar(T, laser_frame)
        return None

    def _chain(self, start: str, goal: str) -> Array | None:
        """Compose the shortest chain, taken forwards or backwards, breadth first."""
        both = {(b, a): np.linalg.inv(T) for (a, b), T in self._edges.items()} | self._edges
        reached, queue = {start: np.eye(4)}, deque([start])
        while queue:
            frame = queue.popleft()
            for (a, b), T in both.items():
                if a == frame and b not in reached:
                    reached[b] = reached[a] @ T
                    queue.append(b)
        return reached.get(goal)


def plain(frame: str) -> str:
    """Frame name without the leading slash of old logs."""
    return frame.lstrip('/')


def yaw(quaternion: Any) -> float:
    """Heading [rad] of a geometry_msgs/Quaternion."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return float(np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z))


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


def _planar(T: Array, laser_frame: str) -> Mount:
    """Project a mount into the plane; ValueError where the laser does not scan the plane."""
    tilt = np.arccos(np.clip(abs(T[2, 2]), 0.0, 1.0))
    if tilt > LARGEST_TILT:
        raise ValueError(f'laser {laser_frame!r} is tilted by {np.degrees(tilt):.0f} deg; '
                         'only level lasers can be used')
    theta = float(np.arctan2(T[1, 0], T[0, 0]))
    return Mount(Pose.from_array((T[0, 3], T[1, 3], theta)), bool(T[2, 2] < 0.0))
