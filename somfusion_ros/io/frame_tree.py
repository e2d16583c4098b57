# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits on the robot: the tree of fixed transforms between base and laser."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.io.frame_names import (BASE_FRAMES, is_moving, plain, prefix, similar,
                                          spellings)

LARGEST_TILT = np.radians(10.0)   # a plane tilted more does not see the walls of one floor plan
LARGEST_TREE = 10000   # transforms; a robot has tens
SAME_PLACE, SAME_HEADING = 0.05, np.radians(3.0)   # [m], [rad] by which mounts are measured


@dataclass(frozen=True)
class Mount:
    """
    T_base_laser of the scan plane, and whether the laser looks at it from below.

    height [m] of the laser above the base; 0 where it is not known.
    """

    T_base_laser: Pose
    upside_down: bool = False
    height: float = 0.0

    def difference(self, told: 'Mount', laser_frame: str) -> str:
        """Say how this mount, which is given, differs from that in TF; '' where it hardly does."""
        if told.upside_down and not self.upside_down:
            return (f'TF has {laser_frame!r} upside down, which laser_pose cannot say: left and '
                    'right are the wrong way round; leave laser_pose out')
        x, y, turn = between(np.array(self.T_base_laser), np.array(told.T_base_laser))
        if np.hypot(x, y) <= SAME_PLACE and abs(turn) <= SAME_HEADING:
            return ''
        theirs = ', '.join(f'{value:.3g}' for value in told.T_base_laser)
        return (f'laser_pose is used, though TF has {laser_frame!r} at {theirs}: leave laser_pose '
                'out if TF is right')


class FrameTree:
    """
    Transforms that never change, by parent and child frame, from any number of messages.

    corrected: parent and child of those that were published anew with other values.
    """

    def __init__(self) -> None:
        self._transforms: dict[tuple[str, str], Array] = {}
        self._parents: dict[str, str] = {}   # as published on tf_static
        self.corrected: list[tuple[str, str]] = []

    def add(self, transforms: Iterable[Any], static: bool = True) -> None:
        """
        Keep geometry_msgs/TransformStamped; what moves or is no rotation is left out.

        Of those published on tf_static the newest holds, of those repeated on tf the first.
        """
        for item in transforms:
            parent, child = plain(item.header.frame_id), plain(item.child_frame_id)
            T = _matrix(item.transform)
            if is_moving(parent) or not np.isfinite(T).all():
                continue
            if static:
                self._correct(parent, child, T)
            elif child not in self._parents and len(self._transforms) < LARGEST_TREE:
                self._transforms.setdefault((parent, child), T)

    def mount(self, base_frame: str, laser_frame: str, robot: str = '') -> Mount | None:
        """
        Compose the chain of transforms from base to laser; None where there is no chain.

        The usual names of the base stand in for one another: encoders name no frame, and a chain
        often begins at base_link where the odometry speaks of base_footprint right below. Names
        are tried with and without the prefix of the robot. ValueError where the laser does not
        scan the plane.
        """
        base_frame, laser_frame = plain(base_frame), plain(laser_frame)
        if laser_frame == base_frame:
            return Mount(Pose())
        known = self._frames()
        before = prefix(base_frame)
        bases = (base_frame, *(plain(f'{before}/{name}') for name in BASE_FRAMES))
        lasers = spellings(laser_frame, robot or before, known)
        for base in (name for frame in bases
                     for name in spellings(frame, robot or prefix(laser_frame), known)):
            for laser in lasers:
                T = self._chain(base, laser)
                if T is not None:
                    return _planar(T, laser)
        return None

    def similar(self, base_frame: str, laser_frame: str, robot: str = '') -> list[str]:
        """Return frames below the base that are spelt like a laser's, where it has no mount."""
        found = similar(laser_frame, robot, self._frames())
        return [name for name in found if self._hangs_on(base_frame, name, robot)]

    def _hangs_on(self, base_frame: str, name: str, robot: str) -> bool:
        """Tell whether there is a chain from the base to a frame, whatever its tilt."""
        try:
            return self.mount(base_frame, name, robot) is not None
        except ValueError:
            return True

    def _frames(self) -> set[str]:
        """Return the names of all frames."""
        return {frame for pair in self._transforms for frame in pair}

    def _correct(self, parent: str, child: str, T: Array) -> None:
        """Keep a transform of tf_static in place of what was known of its child."""
        before = self._parents.get(child)
        if before is not None and (before != parent or not np.allclose(
                T, self._transforms[before, child], atol=1e-4)):
            self.corrected.append((parent, child))
            del self._transforms[before, child]
            del self.corrected[:-LARGEST_TREE]
        if before is None and len(self._transforms) >= LARGEST_TREE:
            return
        self._transforms[parent, child], self._parents[child] = T, parent

    def _chain(self, start: str, goal: str) -> Array | None:
        """Compose the shortest chain, taken forwards or backwards, breadth first."""
        both = {(b, a): np.linalg.inv(T) for (a, b), T in self._transforms.items()}
        both |= self._transforms
        reached, queue = {start: np.eye(4)}, deque([start])
        while queue:
            frame = queue.popleft()
            for (a, b), T in both.items():
                if a == frame and b not in reached:
                    reached[b] = reached[a] @ T
                    queue.append(b)
        return reached.get(goal)


def yaw(quaternion: Any) -> float:
    """Return the heading [rad] of a geometry_msgs/Quaternion."""
    x, y, z, w = quaternion.x, quaternion.y, quaternion.z, quaternion.w
    return float(np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z))


def _matrix(transform: Any) -> Array:
    """Return the matrix (4, 4) of a geometry_msgs/Transform; NaN where it is no rotation."""
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
    return Mount(Pose.from_array((T[0, 3], T[1, 3], theta)), bool(T[2, 2] < 0.0),
                 float(T[2, 3]))
