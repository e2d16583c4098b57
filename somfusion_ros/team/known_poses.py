# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Poses of maps that the user gave, each for the map that the robot had then."""

from collections.abc import Mapping

import numpy as np
from somfusion_ros.geometry import between, Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint

COVARIANCE = np.zeros((3, 3))   # of a pose that the user gave; the drift of maps remains


class KnownPoses:
    """The user's word on where maps lie, which lapses with the maps that it was given for."""

    def __init__(self, poses: Mapping[str, Pose]) -> None:
        self._poses = dict(poses)
        self._epochs: dict[str, Epoch] = {}
        self._lapsed: set[str] = set()

    def bind(self, robot: str, epoch: Epoch) -> None:
        """Note which map of a robot the user means: the first, of now or as it says itself."""
        if robot in self._poses:
            self._epochs.setdefault(robot, epoch)

    def rebind(self, epochs: Mapping[str, Epoch]) -> None:
        """Take the maps of now for those that the user means."""
        self._epochs = {robot: epochs[robot] for robot in self._poses if robot in epochs}
        self._lapsed.clear()

    def holding(self, epochs: Mapping[str, Epoch]) -> dict[str, Pose]:
        """Return the poses, by robot, that hold for the maps of now."""
        return {robot: self._poses[robot] for robot, epoch in self._epochs.items()
                if robot in epochs and epochs[robot].same_map(epoch)}

    def given(self, robot: str) -> Epoch | None:
        """Return the map of a robot that the user means; None where no pose was given."""
        return self._epochs.get(robot)

    def lapsed(self, epochs: Mapping[str, Epoch]) -> list[str]:
        """Return robots whose pose was given for a map that they no longer have, each once."""
        lapsed = {robot for robot, epoch in self._epochs.items()
                  if not epochs.get(robot, epoch).same_map(epoch)} - self._lapsed
        self._lapsed |= lapsed
        return sorted(lapsed)

    def constraints(self, epochs: Mapping[str, Epoch]) -> list[MapConstraint]:
        """Tie the maps together whose poses hold."""
        known = self.holding(epochs)
        anchor = min(known, default='')
        return [MapConstraint(anchor, robot, Pose.from_array(between(known[anchor], pose)),
                              COVARIANCE, kind='known')
                for robot, pose in sorted(known.items()) if robot != anchor]
