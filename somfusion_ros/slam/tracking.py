# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The current pose, one motion away from the last view: predict from odometry, correct by a match.

Older views gain nothing from a match against the newest ones, so the filter's current pose is
kept as a small filter of its own, relative to the last view, and every scan costs the same
however long the robot has driven.
"""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import (Array, between, compose, compose_jacobians, difference,
                                    squared_mahalanobis, wrap)
from somfusion_ros.slam.calibration import Calibration
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.covariance import along, HANDED_ON, ScaleError, sweep_covariance, turned
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import FEWEST, Match, register
from somfusion_ros.slam.motion import increment_covariance, MotionNoise, Odometry
from somfusion_ros.slam.recovery import Attempt, attempts, near, rivals, same
from somfusion_ros.slam.restart import odometry_began_anew
from somfusion_ros.slam.scan import Cloud

DOUBT = 36.0             # squared Mahalanobis distance at which match and odometry disagree
AGREED = 9.0             # squared Mahalanobis distance at which they agree
SIMILAR = 0.05           # share of points by which a match must win over the odometry's
SUDDEN = 0.5             # share of the usual inlier ratio below which something happened
TYPICAL = 0.9            # and above which nothing did, whatever the odometry's sigmas say,
BROKE = (0.3, 0.3)       # [m] [rad] unless the odometry broke off the motion by more than this
MEMORY = 0.2             # weight of the newest scan in the usual inlier ratio
JUMP_SPEED = (4.0, 6.0)  # [m/s] [rad/s] that no indoor robot's odometry reports
LOST_SIGMA = (0.5, 0.3, 0.5)              # [m] [m] [rad] added once the robot is lost
CATCH_UP = 3.0           # [s] within which stalled odometry may report what it left out
LOOSE = 4.0              # times the odometry's sigmas, for the hold on a match


@dataclass(frozen=True, eq=False)
class Track:
    """
    The state after one scan.

    T_view_base (3,) from the last view, the covariance R (3, 3) with which the views after this
    one inherit its error, whether a match corrected it, the share of the scan that the match
    explained, and what was wrong, '' if nothing.
    """

    T_view_base: Array
    R: Array
    matched: bool
    inlier_ratio: float
    reason: str


class Tracker:
    """Follows the robot from the last view."""

    def __init__(self, config: SlamConfig) -> None:
        self.config = config
        self._noise = MotionNoise()
        self._map: LocalMap | None = None
        self.odometry: Odometry | None = None
        self.T_view_base, self.P = np.zeros(3), np.zeros((3, 3))
        self._scale = ScaleError()
        self._velocity, self._dt = np.zeros(3), 0.0
        self._unseen = 0.0           # [s] since the last match
        self._usual = 0.0            # inlier ratio of late
        self.lost = False
        self._resumed = False
        self._anchor: tuple[Odometry, Array] | None = None   # before odometry and match differed
        self.calibration = Calibration()

    def state(self) -> dict[str, Array]:
        """Give what `resume` goes on from: all but the local map, as arrays by name."""
        odometry, c = self.odometry, self.calibration
        return {'T_view_base': self.T_view_base, 'P': self.P, 'velocity': self._velocity,
                'odometry': np.zeros(0) if odometry is None else np.array(
                    [odometry.stamp, *odometry.pose, *odometry.twist]),
                'since': np.array([self._dt, self._unseen, self._usual, self.lost]),
                'turning': c.turning, 'P_turning': c.P_turning,
                'travelling': c.travelling, 'P_travelling': c.P_travelling,
                'scale': self._scale.derivatives}

    def resume(self, state: dict[str, Array]) -> None:
        """Go on from what `state` gave."""
        s, c = {name: value.copy() for name, value in state.items()}, self.calibration
        self.T_view_base, self.P, self._velocity = s['T_view_base'], s['P'], s['velocity']
        if len(s['odometry']):
            stamp, odometry = s['odometry'][0], s['odometry'][1:]
            self.odometry = Odometry(float(stamp), odometry[:3], odometry[3:])
        self._dt, self._unseen, self._usual = (float(value) for value in s['since'][:3])
        self.lost = bool(s['since'][3])
        c.turning, c.P_turning = s['turning'], s['P_turning']
        c.travelling, c.P_travelling = s['travelling'], s['P_travelling']
        self._scale.derivatives = s['scale']
        self._resumed = True

    def start_view(self, local_map: LocalMap) -> None:
        """Make the current pose the last view, seen with the local map around it."""
        self._map = local_map
        if self._anchor is not None:
            self._anchor = self._anchor[0], between(self.T_view_base, self._anchor[1])
        T = turned(self.T_view_base[2])
        self.P = (1.0 - HANDED_ON) * T @ self.P @ T.T
        self._scale.start_view(self.T_view_base[2])
        self.T_view_base = np.zeros(3)

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of T_view_base, with the unknown scale of the odometry."""
        return self.P + self._scale_covariance()

    def _scale_covariance(self) -> Array:
        return self._scale.covariance(self.calibration.P_travelling[0, 0])

    def step(self, scan: Cloud, odometry: Odometry) -> Track:
        """Predict to the scan's odometry, then correct by matching the scan."""
        if self._resumed and len(scan) >= FEWEST:
            self._resumed = False
            if odometry_began_anew(scan, self._map, self.T_view_base,
                                   between(self.odometry.pose, odometry.pose)):
                self.odometry = odometry
        before, previous, was_lost = self.T_view_base, self.odometry, self.lost
        reason = self._predict(odometry)
        matched, ratio = False, 0.0
        if self._map is not None and len(scan) >= FEWEST:
            match, matched = self._match(scan, before, bool(reason))
            self._keep_anchor(match, previous, before)
            ratio = match.inlier_ratio
            if matched:
                self._correct(match, match.covariance + sweep_covariance(
                    scan.sweep, odometry.twist))
                if not (reason or was_lost) and ratio >= self.config.doubtful_inlier_ratio:
                    self.calibration.learn(previous, odometry,
                                           between(before, self.T_view_base),
                                           along(match.covariance, self.T_view_base[2]))
            else:
                reason = reason or ('lost' if self.lost else 'match_rejected')
        if matched:
            self._unseen = 0.0
            self._usual += MEMORY * (ratio - self._usual)
        if self._dt > 0.0 and not self.lost:
            self._velocity = between(before, self.T_view_base) / self._dt
        R = HANDED_ON * self.P + self._scale_covariance()
        return Track(self.T_view_base, R, matched, ratio, reason)

    def _predict(self, odometry: Odometry) -> str:
        """Compose the odometry's increment (section II-A); return what is wrong with it."""
        previous, self.odometry = self.odometry, odometry
        if previous is None:
            return ''
        step = self.calibration.correct(between(previous.pose, odometry.pose))
        Q = increment_covariance(step, self._noise, odometry.slip_since(previous))
        dt = self._dt = max(odometry.stamp - previous.stamp, 0.05)
        self._unseen += dt
        reason = ''
        if (np.hypot(step[0], step[1]) > JUMP_SPEED[0] * dt + 0.5
                or abs(step[2]) > JUMP_SPEED[1] * dt + 0.5):
            step, Q, reason = np.zeros(3), np.diag([0.5, 0.5, 0.5]) ** 2, 'odometry_jumps'
        F, G = compose_jacobians(self.T_view_base, step)
        self.T_view_base = compose(self.T_view_base, step)
        self.P = F @ self.P @ F.T + G @ Q @ G.T
        self._scale.predict(F, G, step)
        return reason

    def _match(self, scan: Cloud, before: Array, jumped: bool) -> tuple[Match, bool]:
        """
        Match from the prediction; where that is doubtful, try every plausible pose.

        Returns the best match and whether to use it. A match near the prediction is used if it
        explains enough of the scan. One that contradicts the odometry must explain most of it,
        and nothing else as much; otherwise the robot is lost until one does.
        """
        seed = self.T_view_base
        hold = np.linalg.inv(LOOSE ** 2 * (self.P + 1e-6 * np.eye(3)))
        match = register(scan, self._map, seed, hold)
        doubtful = jumped or self.lost
        if (not doubtful and match.inlier_ratio >= self.config.doubtful_inlier_ratio
                and self._is_plausible(match)):
            return match, True
        coasted = compose(before, self._velocity * self._dt)
        expected = [seed, coasted, *self._caught_up()]
        tried = attempts(scan, self._map, match, expected, self._unseen, hold)
        worth = max(a.worth for a in tried)
        best = min((a for a in tried if a.worth > worth - SIMILAR),
                   key=lambda a: min(self._disagreement(a.match, pose) for pose in expected))
        ratio = best.match.inlier_ratio
        stalled = ratio < SUDDEN * self._usual and not near(seed, coasted, BROKE)
        if not (doubtful or stalled) and self._disagreement(best.match) < DOUBT:
            return best.match, ratio >= self.config.minimum_inlier_ratio
        return best.match, self._found(best, tried, expected)

    def _is_plausible(self, match: Match) -> bool:
        """Tell whether a match agrees with the odometry, or explains as much as usual near it."""
        return (self._disagreement(match) < DOUBT
                or match.inlier_ratio >= TYPICAL * self._usual
                and near(match.T_map_scan, self.T_view_base, BROKE))

    def _found(self, best: Attempt, tried: list[Attempt], expected: list[Array]) -> bool:
        """
        Tell whether a match is clear enough to overrule the odometry; else become lost.

        Less of the scan is enough where the search finds the same, and the odometry or the robot's
        own motion expects it.
        """
        confirmed = same(best, tried[-1]) and (self._disagreement(best.match) < AGREED or any(
            near(best.match.T_map_scan, pose, BROKE) for pose in expected[1:]))
        enough = (self.config.minimum_inlier_ratio if confirmed
                  else self.config.doubtful_inlier_ratio)
        found = best.match.inlier_ratio >= enough and not rivals(best, tried)
        if not found and not self.lost:
            self.P = self.P + np.diag(LOST_SIGMA) ** 2
        self.lost = not found
        return found

    def _keep_anchor(self, match: Match, previous: Odometry, before: Array) -> None:
        """Keep the last pose before odometry and match differed, until they agree again."""
        differ = self.lost or self._disagreement(match) >= DOUBT
        caught_up = any(near(match.T_map_scan, pose, BROKE) for pose in self._caught_up())
        if not differ or caught_up:
            self._anchor = None
        elif self._anchor is None and previous is not None:
            self._anchor = previous, before

    def _caught_up(self) -> list[Array]:
        """Give the pose (3,), if any, at which the odometry sees itself from the anchor."""
        if self._anchor is None or self.odometry.stamp - self._anchor[0].stamp > CATCH_UP:
            return []
        odometry, pose = self._anchor
        return [compose(pose, self.calibration.correct(
            between(odometry.pose, self.odometry.pose)))]

    def _disagreement(self, match: Match, expected: Array | None = None) -> float:
        """Squared Mahalanobis distance between a match and the prediction, or another pose."""
        y = difference(match.T_map_scan, self.T_view_base if expected is None else expected)
        return squared_mahalanobis(y, self.P + match.covariance)

    def _correct(self, match: Match, R: Array) -> None:
        """Kalman update of the current pose; a slip shows as disagreement and widens P first."""
        P = self.P * max(1.0, self._disagreement(match) / 9.0) + 1e-9 * np.eye(3)
        K = P @ np.linalg.inv(P + R)
        x = self.T_view_base + K @ difference(match.T_map_scan, self.T_view_base)
        x[2] = wrap(x[2])
        self.T_view_base = x
        I_K = np.eye(3) - K
        self.P = I_K @ P @ I_K.T + K @ R @ K.T
        self._scale.correct(I_K)
