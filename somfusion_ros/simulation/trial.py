# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated drives with truth, in memory: what the sensors tell, and how far the SLAM is off."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import Array, between, compose, Pose, wrap
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step
from somfusion_ros.slam.wheel_odometry import WheelOdometry

ODOMETRY_EVERY = 3         # simulated steps between two samples of the odometry
SICK = Laser(beams=181, field_of_view=float(np.pi), range_max=30.0, period=0.2, turn=0.0,
             noise_per_metre=0.0, mount=Pose(0.2, 0.0, 0.0), range_min=0.1)
Scenery = Callable[[float], Scene]


@dataclass(frozen=True, eq=False)
class Trial:
    """
    What the sensors told on one drive, and the truth.

    Scans; odometry stamps (M,) [s], poses (M, 3), slip (M, 3) as in `Odometry`, and wheels (M, 2)
    [rad]; true stamps (T,) [s] and poses (T, 3) in the frame of the first scan.
    """

    scans: list[Scan]
    odometry_stamps: Array
    odometry: Array
    slip: Array
    wheels: Array
    stamps: Array
    poses: Array

    def truth(self, stamps: Array) -> Array:
        """Return the true poses (k, 3) at times (k,) [s]."""
        return drive.at(self.stamps, self.poses, stamps)

    def then(self, second: 'Trial', start: Array, laser: Laser) -> 'Trial':
        """
        Go on with a second drive, from a pose (3,) in the frame of the first scan.

        Its sensors tell on a scan later, as if nothing had happened: the robot was taken up.
        """
        later = float(self.scans[-1].stamp + laser.period)
        told, true = self.odometry_stamps < later, self.stamps < later
        return Trial(
            [*self.scans, *(replace(scan, stamp=scan.stamp + later) for scan in second.scans)],
            np.concatenate([self.odometry_stamps[told], second.odometry_stamps + later]),
            np.concatenate([self.odometry[told],
                            compose(self.odometry[told][-1], second.odometry)]),
            np.concatenate([self.slip[told], self.slip[told][-1] + second.slip]),
            np.concatenate([self.wheels[told], self.wheels[told][-1] + second.wheels]),
            np.concatenate([self.stamps[true], second.stamps + later]),
            np.concatenate([self.poses[true], compose(start, second.poses)]))


@dataclass(frozen=True, eq=False)
class Outcome:
    """
    What the SLAM made of a trial.

    error (N, 3) of the pose told at each scan, covariance (N, 3, 3) told with it, corrected
    (K, 3): error of the final trajectory; all as estimate minus truth in the map frame.
    """

    slam: Slam
    steps: list[Step]
    error: Array
    covariance: Array
    corrected: Array

    @property
    def distance(self) -> Array:
        """Distance (K,) [m] of the final trajectory from the truth."""
        return np.hypot(self.corrected[:, 0], self.corrected[:, 1])

    @property
    def nees(self) -> Array:
        """Normalised estimation error squared (N,) of the poses told; nan where none is told."""
        usable = self.covariance[:, 2, 2] > 1e-12
        e, P = self.error[usable], self.covariance[usable]
        found = np.full(len(self.error), np.nan)
        found[usable] = np.einsum('ni,ni->n', e, np.linalg.solve(P, e[..., None])[..., 0])
        return found


def simulate_trial(scenery: Scenery, stamps: Array, poses: Array, laser: Laser,
                   rng: np.random.Generator, wheels: drive.Wheels = drive.NOMINAL,
                   slip: float = drive.SLIP) -> Trial:
    """
    Let the sensors tell what they see along true poses (T, 3) at stamps (T,) [s].

    wheels are the real ones, where the odometry believes in the nominal; slip is their random
    error [m] after one metre.
    """
    angles = drive.encoders(poses, wheels, rng, slip)[::ODOMETRY_EVERY]
    reckoning = WheelOdometry(drive.NOMINAL.left, drive.NOMINAL.separation)
    odometry, slips = (np.array(part) for part in zip(
        *((reckoning.update(*pair), reckoning.slip) for pair in angles), strict=True))
    scans, beams = [], laser.beam_times()
    for start in np.arange(0.0, stamps[-1] - beams[-1], laser.period):
        scans.append(laser.scan(start, scenery(start), drive.at(stamps, poses, start + beams),
                                rng))
    return Trial(scans, stamps[::ODOMETRY_EVERY], odometry, slips, angles, stamps,
                 between(poses[0], poses))


def run_trial(trial: Trial, config: SlamConfig | None = None, slam: Slam | None = None) -> Outcome:
    """Run the SLAM over a trial, and compare with the truth."""
    slam, buffer, steps = slam or Slam(config), OdometryBuffer(), []
    for sample in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        buffer.add(*sample)
    for scan in trial.scans:
        buffer.lag = slam.odometry_lag
        odometry = buffer.at(scan.stamp, scan.sweep)
        if odometry is not None:
            steps.append(slam.process(scan, odometry))
    stamps, poses = slam.trajectory()
    told = np.array([s.pose for s in steps])
    return Outcome(slam, steps, _error(told, trial.truth(np.array([s.stamp for s in steps]))),
                   np.array([s.covariance for s in steps]),
                   _error(poses, trial.truth(stamps)))


def _error(estimated: Array, true: Array) -> Array:
    """Estimate minus truth (n, 3) in the map frame."""
    e = estimated - true
    e[:, 2] = wrap(e[:, 2])
    return e
