# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The current pose, one motion away from the last view: predict from odometry, correct by a match.

Older views gain nothing from a match against the newest ones, so the filter's current pose is
kept as a small filter of its own, relative to the last view, and every scan costs the same
however long the robot has driven.
"""

import numpy as np
from somfusion_ros.geometry import (Array, between, compose, compose_jacobians, difference,
                                    squared_mahalanobis, wrap)
from somfusion_ros.slam.agreement import looks_through
from somfusion_ros.slam.anchor import Anchor
from somfusion_ros.slam.bursts import Bursts
from somfusion_ros.slam.calibration import Calibration
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.covariance import along, ScaleError, seen_turned, sweep_covariance
from somfusion_ros.slam.covariance import TUNING as INHERITED
from somfusion_ros.slam.gyro import by_gyro
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.matching import FEWEST, Match, register
from somfusion_ros.slam.motion import increment_covariance, MotionNoise, Odometry
from somfusion_ros.slam.recovery import Attempt, attempts, near, rivals, same
from somfusion_ros.slam.restart import odometry_began_anew
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.slam.track import Track
from somfusion_ros.slam.tracker_state import TrackerState
from somfusion_ros.slam.tracking_tuning import TUNING


class Tracker:
    """Follows the robot from the last view."""

    def __init__(self, config: SlamConfig) -> None:
        self.config = config
        self._noise = MotionNoise()
        self.around: LocalMap | None = None
        self.odometry: Odometry | None = None
        self.T_view_base, self.P = np.zeros(3), np.zeros((3, 3))
        self._scale = ScaleError()
        self._velocity, self._dt = np.zeros(3), 0.0
        self._unseen, self.usual = 0.0, 0.0   # [s] since the last match, inlier ratio of late
        self.lost = self.resumed = False
        self.placed = False         # whether the next match tells motion only, no correction
        self._anchor, self._bursts = Anchor(), Bursts()
        self.calibration = Calibration()

    def state(self) -> TrackerState:
        """Return what `resume` goes on from; later scans do not change it."""
        c = self.calibration
        return TrackerState(
            T_view_base=self.T_view_base, P=self.P, velocity=self._velocity,
            odometry=self.odometry, dt=self._dt, unseen=self._unseen, usual=self.usual,
            lost=self.lost, turning=c.turning.copy(), P_turning=c.P_turning.copy(),
            travelling=c.travelling.copy(), P_travelling=c.P_travelling.copy(),
            scale=self._scale.derivatives)

    def resume(self, state: TrackerState) -> None:
        """Go on from a state."""
        s, c = state, self.calibration
        self.T_view_base, self.P, self._velocity = s.T_view_base, s.P, s.velocity
        self.odometry, self.lost = s.odometry, s.lost
        self._dt, self._unseen, self.usual = s.dt, s.unseen, s.usual
        c.turning, c.P_turning = s.turning.copy(), s.P_turning.copy()
        c.travelling, c.P_travelling = s.travelling.copy(), s.P_travelling.copy()
        self._scale.derivatives = s.scale
        self.resumed, self.placed = True, False

    def start_view(self, local_map: LocalMap) -> None:
        """Make the current pose the last view, seen with the local map around it."""
        self.around, self.placed = local_map, True
        self._anchor.reframe(self.T_view_base, np.zeros(3))
        self.P = (1.0 - INHERITED.handed_on) * seen_turned(self.P, self.T_view_base[2])
        self._scale.start_view(self.T_view_base[2])
        self.T_view_base = np.zeros(3)

    def go_on(self, local_map: LocalMap, T_view_base: Array, P: Array) -> None:
        """Go on from another view, with the local map around it, at a pose and covariance."""
        self.around = local_map
        self._anchor.reframe(self.T_view_base, T_view_base)
        self.T_view_base, self.P, self.lost = T_view_base, P, False
        self._scale.forget()

    @property
    def covariance(self) -> Array:
        """Covariance (3, 3) of T_view_base, with the unknown scale of the odometry."""
        return self.P + self._scale.covariance(self.calibration.P_travelling[0, 0])

    def step(self, scan: Cloud, odometry: Odometry) -> Track:
        """Predict to the scan's odometry, then correct by matching the scan."""
        if self.resumed and len(scan) >= FEWEST:
            self.resumed = False
            if self._began_anew(scan, odometry):
                self.odometry = odometry
        self.odometry = odometry.corrected(self.odometry)
        before, previous, was_lost = self.T_view_base, self.odometry, self.lost
        reason = self._predict(odometry)
        matched, ratio, seed = False, 0.0, self.T_view_base
        if self.around is not None and min(len(scan), len(self.around)) >= FEWEST:
            match, matched = self._match(scan, self.around, before, bool(reason))
            self._keep_anchor(match, previous, before)
            ratio = match.inlier_ratio
            if matched:
                self._correct(match, match.covariance + sweep_covariance(
                    scan.sweep, odometry.twist))
                if (previous is not None and odometry.measured and not (reason or was_lost)
                        and ratio >= self.config.doubtful_inlier_ratio):
                    self.calibration.learn(previous, odometry,
                                           between(before, self.T_view_base),
                                           along(match.covariance, self.T_view_base[2]))
            elif not self.lost and looks_through(self.T_view_base, scan, self.around):
                self._lose()
            if not matched:
                reason = reason or ('lost' if self.lost else 'match_rejected')
        if matched:
            self._unseen = 0.0
            self.usual += TUNING.memory * (ratio - self.usual)
        if self._dt > 0.0 and not self.lost:
            self._velocity = between(before, self.T_view_base) / self._dt
        R = self.covariance - (1.0 - INHERITED.handed_on) * self.P
        expected = near(self.T_view_base, seed, TUNING.broke)
        moved = between(before, self.T_view_base) if matched and self.placed else None
        self.placed = matched
        return Track(self.T_view_base, R, matched, ratio, expected, reason, moved)

    def _began_anew(self, scan: Cloud, odometry: Odometry) -> bool:
        """Return whether the odometry of the first scan after a restart begins at another pose."""
        return (self.around is not None and self.odometry is not None
                and odometry_began_anew(scan, self.around, self.T_view_base,
                                        between(self.odometry.pose, odometry.pose)))

    def _predict(self, odometry: Odometry) -> str:
        """Compose the odometry's increment (section II-A); return what is wrong with it."""
        previous, self.odometry = self.odometry, odometry
        if previous is None:
            return ''
        step = self.calibration.correct(between(previous.pose, odometry.pose))
        Q = increment_covariance(step, self._noise, odometry.slip_since(previous))
        step, Q = by_gyro(step, Q, previous, odometry)
        dt, unknown = self._bursts.judge(odometry.stamp - previous.stamp, self._velocity)
        self._dt, Q = dt, Q + unknown
        self._unseen += dt
        reason = ''
        if (np.hypot(step[0], step[1]) > min(TUNING.jump_speed[0] * dt + 0.5, TUNING.jump)
                or abs(step[2]) > TUNING.jump_speed[1] * dt + 0.5):
            step, Q, reason = np.zeros(3), np.diag([0.5, 0.5, 0.5]) ** 2, 'odometry_jumps'
        F, G = compose_jacobians(self.T_view_base, step)
        self.T_view_base = compose(self.T_view_base, step)
        self.P = F @ self.P @ F.T + G @ Q @ G.T
        self._scale.predict(F, G, step)
        return reason

    def _match(self, scan: Cloud, around: LocalMap, before: Array, jumped: bool
               ) -> tuple[Match, bool]:
        """
        Match from the prediction; where that is doubtful, try every plausible pose.

        Returns the best match and whether to use it. A match near the prediction is used if it
        explains enough of the scan. One that contradicts the odometry must explain most of it,
        and nothing else as much; otherwise the robot is lost until one does.
        """
        seed = self.T_view_base
        hold = np.linalg.inv(TUNING.loose ** 2 * (self.P + 1e-6 * np.eye(3)))
        match = register(scan, around, seed, hold)
        doubtful = jumped or self.lost
        guessed = (self.odometry is not None and not self.odometry.measured
                   and self._dt > TUNING.guessed)
        if not (doubtful or guessed) and (
                match.inlier_ratio >= self.config.doubtful_inlier_ratio
                and self._is_plausible(match)):
            return match, True
        coasted = compose(before, self._velocity * self._dt)
        expected = [seed, coasted, *self._caught_up()]
        tried = attempts(scan, around, match, expected, self._unseen, hold)
        worth = max(a.worth for a in tried)
        best = min((a for a in tried if a.worth > worth - TUNING.similar),
                   key=lambda a: min(self._disagreement(a.match, pose) for pose in expected))
        ratio = best.match.inlier_ratio
        stalled = ratio < TUNING.sudden * self.usual and not near(seed, coasted, TUNING.broke)
        if not (doubtful or stalled) and self._disagreement(best.match) < TUNING.doubt:
            return best.match, ratio >= self.config.minimum_inlier_ratio
        return best.match, self._found(best, tried, expected)

    def _is_plausible(self, match: Match) -> bool:
        """Return whether a match agrees with the odometry, or explains the usual share near it."""
        return (self._disagreement(match) < TUNING.doubt
                or match.inlier_ratio >= TUNING.typical * self.usual
                and near(match.T_map_scan, self.T_view_base, TUNING.broke))

    def _found(self, best: Attempt, tried: list[Attempt], expected: list[Array]) -> bool:
        """
        Tell whether a match is clear enough to overrule the odometry; else become lost.

        Less of the scan is enough where the search finds the same, and the odometry or the robot's
        own motion expects it.
        """
        expects = (self._disagreement(best.match) < TUNING.agreed or any(
            near(best.match.T_map_scan, pose, TUNING.broke) for pose in expected[1:]))
        confirmed = same(best, tried[-1]) and expects
        enough = (self.config.minimum_inlier_ratio if confirmed
                  else self.config.doubtful_inlier_ratio)
        if self.lost and not self._sparse:   # a carried robot must not settle for what little fits
            enough = max(enough, TUNING.regained * self.usual)
        found = best.match.inlier_ratio >= enough and not rivals(best, tried)
        if not found and not self.lost:
            self._lose()
        self.lost = not found
        return found

    def _lose(self) -> None:
        """Be lost until a match is clear."""
        self.P = self.P + np.diag(TUNING.lost_sigma) ** 2
        self.lost = True

    @property
    def _sparse(self) -> bool:
        """Whether scans lie as far apart as views, so that they have less in common anyway."""
        return bool(np.hypot(*(self._dt * self._velocity[:2]))
                    > self.config.minimum_travel_distance)

    def _keep_anchor(self, match: Match, previous: Odometry | None, before: Array) -> None:
        """Remember the last pose before odometry and match differed, until they agree again."""
        differ = self.lost or self._disagreement(match) >= TUNING.doubt
        caught_up = any(near(match.T_map_scan, pose, TUNING.broke) for pose in self._caught_up())
        if not differ or caught_up:
            self._anchor.drop()
        else:
            self._anchor.hold(previous, before)

    def _caught_up(self) -> list[Array]:
        """Return where the odometry is if it left nothing out, as a list of one or none."""
        return self._anchor.reckoned(self.odometry, self.calibration)

    def _disagreement(self, match: Match, expected: Array | None = None) -> float:
        """Return the squared Mahalanobis distance of a match to the prediction or a pose."""
        y = difference(match.T_map_scan, self.T_view_base if expected is None else expected)
        return squared_mahalanobis(y, self.P + match.covariance)

    def _correct(self, match: Match, R: Array) -> None:
        """Update the current pose (Kalman); a slip shows as disagreement and widens P first."""
        P = self.P * max(1.0, self._disagreement(match) / 9.0) + 1e-9 * np.eye(3)
        K = P @ np.linalg.inv(P + R)
        x = self.T_view_base + K @ difference(match.T_map_scan, self.T_view_base)
        x[2] = wrap(x[2])
        self.T_view_base = x
        I_K = np.eye(3) - K
        self.P = I_K @ P @ I_K.T + K @ R @ K.T
        self._scale.correct(I_K)
