# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of maps that the user gave, each for the map that the robot had then.

A robot that is started anew without its map may stand anywhere, though its launch file gives the
same pose again: only the user knows. So a pose is of the first map of a robot that anyone for
whom a pose was given has known, and who knows better says so; the others deny it as well. Where
the robot does stand there, the user says so on every robot, by forgetting all verdicts.
"""

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
        self._said: dict[str, dict[str, Epoch]] = {}    # by peers, of which maps it is not
        self._denied: dict[str, Epoch] = {}
        self._sure: dict[str, Epoch] = {}      # of which maps it is, as the user said
        self._lapsed: set[str] = set()

    def bind(self, robot: str, epoch: Epoch) -> None:
        """Note which map of a robot the user means: the first, of now or as it says itself."""
        if robot in self._poses:
            self._epochs.setdefault(robot, epoch)

    def rebind(self, epochs: Mapping[str, Epoch]) -> None:
        """Take the maps of now for those that the user means, whatever others say."""
        self._epochs = {robot: epochs[robot] for robot in self._poses if robot in epochs}
        self._sure = dict(self._epochs)
        self._denied.clear()
        self._lapsed.clear()

    def hear(self, owner: str, denied: Mapping[str, Epoch]) -> None:
        """Replace of which maps of robots the given poses are not, as a peer says."""
        if owner in self._poses:
            self._said[owner] = {robot: epoch for robot, epoch in denied.items()
                                 if robot in self._poses}

    def denied(self, epochs: Mapping[str, Epoch]) -> dict[str, Epoch]:
        """Return the maps of now, by robot, of which the given poses are not."""
        for said in self._said.values():
            for robot, epoch in said.items():
                if robot in epochs and epochs[robot].same_map(epoch) and not (
                        robot in self._sure and self._sure[robot].same_map(epoch)):
                    self._denied[robot] = epoch      # also when nobody says it any more
        return {robot: epochs[robot] for robot, bound in sorted(self._epochs.items())
                if robot in epochs and not (epochs[robot].same_map(bound) and not (
                    robot in self._denied and epochs[robot].same_map(self._denied[robot])))}

    def holding(self, epochs: Mapping[str, Epoch]) -> dict[str, Pose]:
        """Return the poses, by robot, that hold for the maps of now."""
        denied = self.denied(epochs)
        return {robot: self._poses[robot] for robot in self._epochs
                if robot in epochs and robot not in denied}

    def given(self, robot: str) -> Epoch | None:
        """Return the map of a robot that the user means; None where no pose was given."""
        return self._epochs.get(robot)

    def lapsed(self, epochs: Mapping[str, Epoch]) -> list[str]:
        """Return robots whose pose is not of the map that they have, each once."""
        lapsed = self.denied(epochs).keys() - self._lapsed
        self._lapsed |= lapsed
        return sorted(lapsed)

    def constraints(self, epochs: Mapping[str, Epoch]) -> list[MapConstraint]:
        """Tie the maps together whose poses hold."""
        known = self.holding(epochs)
        anchor = min(known, default='')
        return [MapConstraint(anchor, robot, Pose.from_array(between(known[anchor], pose)),
                              COVARIANCE, kind='known')
                for robot, pose in sorted(known.items()) if robot != anchor]
