# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The frame `world`: whose map frame it is, and when a robot's place in it changes."""

from collections.abc import Callable, Mapping

import numpy as np
from somfusion_ros.geometry import Array, between, between_jacobians, Pose
from somfusion_ros.team.gliding import TUNING as STEP
from somfusion_ros.team.words import ordinal


def anchored(group: Mapping[str, Pose], anchor: str) -> dict[str, Pose]:
    """
    Express T_world_map by robot in the map frame of an anchor, where it is one of the group.

    Otherwise `world` stays what the group has agreed on without voting: the map frame of the
    member whose name sorts first.
    """
    if anchor not in group:
        return dict(group)
    return {robot: Pose.from_array(between(group[anchor], pose)) for robot, pose in group.items()}


def anchored_covariances(group: Mapping[str, Pose], covariances: Mapping[str, Array],
                         anchor: str) -> dict[str, Array]:
    """
    Express the covariances (3, 3) of T_world_map by robot in the map frame of an anchor.

    How the errors of two maps hang together is not known: they are taken to be independent, which
    makes the sum no smaller than it is.
    """
    P = {robot: covariances.get(robot, np.zeros((3, 3))) for robot in group}
    if anchor not in group:
        return P
    found = {anchor: np.zeros((3, 3))}
    for robot in group.keys() - {anchor}:
        by_anchor, by_robot = between_jacobians(group[anchor], group[robot])
        found[robot] = by_anchor @ P[anchor] @ by_anchor.T + by_robot @ P[robot] @ by_robot.T
    return found


def anchor_of(group: Mapping[str, Pose], anchor: str) -> str:
    """Name the robot of a group whose map frame is `world`."""
    return anchor if anchor in group else min(group)


class WorldWatch:
    """
    Notices that `world` changed for one robot: goals and maps in it are elsewhere now.

    changes: how often it did. A change is a move of T_world_map by more than a distance [m] or a
    heading [rad] since the last one, by more than a step (STEP) at once, or another robot's map
    frame in its place.
    """

    def __init__(self, robot: str, distance: float, heading: float,
                 say: Callable[[str], object]) -> None:
        self._robot, self._distance, self._heading, self._say = robot, distance, heading, say
        self._anchor, self._place = robot, Pose()
        self._last = Pose()
        self.changes = 0

    def look(self, world: Mapping[str, Pose], anchor: str) -> None:
        """Compare T_world_map by robot, in the map frame of an anchor, with what it was."""
        place = world[self._robot]
        moved = (_apart(self._place, place, self._distance, self._heading)
                 or _apart(self._last, place, STEP.distance, STEP.heading))
        self._last = place
        if not moved and anchor == self._anchor:
            return
        self.changes += 1
        self._say(f'world changed, for the {ordinal(self.changes)} time: it is the map frame of '
                  f'{anchor} now, and the map of {self._robot} lies at {place.x:.2f} m, '
                  f'{place.y:.2f} m, {np.degrees(place.theta):.1f} deg in it (before: the map '
                  f'frame of {self._anchor}, at {self._place.x:.2f} m, {self._place.y:.2f} m, '
                  f'{np.degrees(self._place.theta):.1f} deg)')
        self._anchor, self._place = anchor, place


def _apart(a: Pose, b: Pose, distance: float, heading: float) -> bool:
    """Return whether two poses lie farther apart than a distance [m] or a heading [rad]."""
    x, y, theta = np.array(between(a, b)) * (1.0 - 1e-6)     # a step may be just as long
    return bool(np.hypot(x, y) > distance or abs(theta) > heading)
