# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A drive through a room, fed to a session as a robot would."""

from collections import Counter
from collections.abc import Callable

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
import numpy as np
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.step import Step

Clock = Callable[[int], float]   # of the number of a message: by how much [s] it is off


class Counts(Counter):
    """Counts faults as the nodes do."""

    def __call__(self, kind: str, reason: str = '') -> None:
        """Count one."""
        self[kind] += 1


class Drive:
    """A drive through a room, fed to a session as a robot would."""

    def __init__(self) -> None:
        """Prepare a session, and a way of 12 s."""
        self.counts = Counts()
        self.session = Session(SlamConfig(), 0.5, self.counts)
        way = np.array([[1.5, 1.5], [3.5, 1.5], [6.5, 1.0], [6.5, 2.8], [4.5, 3.0], [2.0, 3.0]])
        self.stamps, self.poses = fake_trajectory(way)
        self.odometry = fake_odometry(self.poses)
        self.steps: list = []

    def feed(self, first: int, last: int, shift: float = 0.0,
             T_odom_odom: Pose | None = None) -> None:
        """Feed a part of the drive, at shifted stamps."""
        for i in range(first, last):
            stamp = self.stamps[i] + shift
            pose = self.odometry[i] if T_odom_odom is None else compose(T_odom_odom,
                                                                        self.odometry[i])
            scan = fake_scan(fake_room(), self.poses[i], stamp, beams=181)
            self.session.add_odometry(stamp, pose)
            self.session.add_scan(scan, i, 0.0)
            self.steps += list(self.session.steps(0.0))

    def error(self) -> float:
        """Distance [m] of the last step from the truth, both from the first step."""
        return self._off(self.steps[-1])

    def worst(self) -> float:
        """Longest distance [m] of a step from the truth, both from the first step."""
        return max(self._off(found) for found in self.steps if found[1].accepted)

    def _off(self, found: tuple[int, Step]) -> float:
        (first, one), (i, other) = self.steps[0], found
        return pose_error(between(one.pose, other.pose),
                          between(self.poses[first], self.poses[i]))[0]


def right(k: int) -> float:
    """Be a clock that is right."""
    return 0.0


def tell_odometry(drive: Drive, i: int, clock: Clock = right) -> None:
    """Tell a sample of the odometry."""
    drive.session.add_odometry(drive.stamps[i] + 1e5 + clock(i), drive.odometry[i])


def tell_scan(drive: Drive, i: int, clock: Clock = right, held: int = 0) -> None:
    """Tell a scan, which was held on its way while so many more were taken."""
    scan = fake_scan(fake_room(), drive.poses[i], drive.stamps[i] + 1e5 + clock(i), beams=181)
    drive.session.add_scan(scan, i, float(drive.stamps[i + held]))


def used(drive: Drive) -> int:
    """Return how many scans were used."""
    return len({tag for tag, step in drive.steps if step.accepted and step.reason != 'lost'})
