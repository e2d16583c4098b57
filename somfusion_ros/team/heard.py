# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What one robot hears of another: when, how much, and where the other one was."""

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from somfusion_ros.geometry import Array, between, compose, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.team.channels import MAP_CHANNELS
from somfusion_ros.team.constraint import chained
from somfusion_ros.team.shared_map import TUNING as MAP

POSES_KEPT = 200
TRAIL_KEPT = 500      # points of a trail
AGES_KEPT = 50         # of views
SESSIONS_KEPT = 8


@dataclass(frozen=True)
class HearingTuning:
    """How long what was heard of a robot is good for."""

    trail_step: float = tuned(
        0.1, 'm', 'a trail keeps a place this often; finer fills it without marking more cells',
        'not measured')
    sighting_tolerance: float = tuned(
        0.5, 's', 'a sighting counts only where a pose is known this near to its stamp; a robot '
        'at 1 m/s moves by half a metre in it', 'not measured')
    longest_gap: float = tuned(
        2.0, 's', 'between two poses with one between them; poses come every second', 'by design')
    speed: float = tuned(
        1.0, 'm/s, rad/s', 'sigma of a robot after its last pose; it only makes sightings less '
        'sure', 'by design')
    uneven: float = tuned(
        0.3, '', 'share of the step between two poses that is its sigma on the way: a robot may '
        'make nearly all of it just before the end', 'by design')
    swerve: float = tuned(
        0.1, 'm/s, rad/s', 'sigma, by the time to the nearer one, of a robot between two poses '
        'that are the same: it may turn away and back', 'simulated teams')
    stepped: float = tuned(
        5.0, 's', 'a stamp that is so much older than the last is of a clock that was set back, '
        'and two clocks must not differ by more in a sighting; a computer under load lags by '
        'seconds', 'by design')
    ahead: float = tuned(
        1.0, 's', 'a stamp so far in the future is of a clock that is ahead, or drifted: longer '
        'than it takes from a scan to a pose that was hardly delayed', 'by design')
    tardy: float = tuned(
        2.5, 's', 'a pose that comes later is counted; they come every second', 'by design')
    name_taken: float = tuned(
        15.0, 's', 'a name is not trusted for this time after two robots were heard under it; '
        'longer than a state takes to be repeated', 'by design')


TUNING = HearingTuning()


class TimedPose(NamedTuple):
    """T_map_base at a stamp [s] with its covariance (3, 3); arrived [s]: when it was heard."""

    stamp: float
    pose: Pose
    covariance: Array
    arrived: float = float('nan')


def check_pose(item: TimedPose) -> None:
    """Raise ValueError, naming what is wrong, on a pose that no robot has in its map."""
    if not np.isfinite([*item.pose, item.stamp, *item.covariance.ravel()]).all():
        raise ValueError('a pose, its stamp or its covariance is not finite')
    if max(abs(item.pose.x), abs(item.pose.y)) > MAP.farthest:
        raise ValueError(f'{item.pose.x:.3g}, {item.pose.y:.3g} is too far for a map')


@dataclass
class Heard:
    """
    What was heard of one robot: times [s] of a steady clock, bytes by channel, recent poses.

    view_ages [s]: how old its newest views were when the global map showed them first.
    late [s]: by how much its newest pose came late, by the listener's clock, nan where unknown.
    """

    at: float = float('-inf')
    map_at: float = float('-inf')
    maps: int = 0
    received: Counter[str] = field(default_factory=Counter)
    poses: deque[TimedPose] = field(default_factory=lambda: deque(maxlen=POSES_KEPT))
    trail: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=TRAIL_KEPT))
    taken_until: float = float('-inf')
    view_ages: deque[float] = field(default_factory=lambda: deque(maxlen=AGES_KEPT))
    late: float = float('nan')
    since: float = float('-inf')    # stamp [s] before which its poses tell nothing
    _begins: bool = False           # with its next pose
    _sessions: deque[str] = field(default_factory=lambda: deque(maxlen=SESSIONS_KEPT))
    _number: int = -1

    def hear(self, channel: str, size: int, now: float) -> None:
        """Count a message of a size [bytes]; maps are counted apart."""
        self.at = now
        self.received[channel] += size
        if channel in MAP_CHANNELS:
            self.map_at, self.maps = now, self.maps + 1

    def begin(self, session: str, now: float) -> bool:
        """
        Note under which session a name speaks; return whether the name can be trusted.

        A node that is started again has a new session. A session that comes back after another
        one means that two robots use the name.
        """
        if session in self._sessions and self._sessions[-1] != session:
            self.taken_until = now + TUNING.name_taken
            self._sessions.remove(session)
        if session not in self._sessions:
            self._sessions.append(session)
            self._number = -1
        return now >= self.taken_until

    @property
    def session(self) -> str:
        """Session under which the name spoke last; '' before the first."""
        return self._sessions[-1] if self._sessions else ''

    def newer(self, number: int) -> bool:
        """Return whether a state is newer than all that came before in its session."""
        newer, self._number = number > self._number, max(number, self._number)
        return newer

    def forget_poses(self) -> None:
        """Forget where the robot was: its map is another one, or was at another state."""
        # Not cleared but replaced: whoever looks at the last of those before finds it still there.
        self.poses, self.trail = deque(maxlen=POSES_KEPT), deque(maxlen=TRAIL_KEPT)
        self._begins = True

    def add_pose(self, item: TimedPose) -> None:
        """Keep a pose, and where the robot has been; those of before its clock was set back go."""
        poses, trail = self.poses, self.trail
        if poses and item.stamp < poses[-1].stamp - TUNING.stepped:
            poses = self.poses = deque(maxlen=POSES_KEPT)
            self._begins = True
        if self._begins:
            self.since, self._begins = item.stamp, False
        poses.append(item)
        here = item.pose.x, item.pose.y
        if not trail or np.hypot(*np.subtract(here, trail[-1])) >= TUNING.trail_step:
            trail.append(here)

    def after(self, stamp: float, now: float) -> float:
        """Return how far [s] in the robot's future a stamp [s] is; nan where it does not know."""
        poses = list(self.poses)
        if not poses or not now - poses[-1].arrived <= TUNING.sighting_tolerance:
            return float('nan')      # it does not know its own time
        return stamp - poses[-1].stamp - (now - poses[-1].arrived)

    def future(self, stamp: float, now: float) -> float:
        """
        Return how far [s] in the robot's future a stamp [s] is; 0 where it may be past.

        By the own pose that came soonest, so that a load that comes and goes does not matter.
        """
        if not np.isfinite(self.after(stamp, now)):
            return 0.0
        ahead = stamp - now + min(item.arrived - item.stamp for item in list(self.poses))
        return ahead if ahead > TUNING.ahead else 0.0

    def pose_at(self, stamp: float) -> TimedPose | None:
        """
        Return T_map_base at a stamp [s], between poses or the nearest; None if none is near.

        The nearest is known the worse the farther it is.
        """
        if stamp < self.since:
            return None
        poses = list(self.poses)   # in one step: another thread adds to them
        after = [item for item in poses if item.stamp >= stamp]
        before = [item for item in poses if item.stamp <= stamp]
        last = max(before, key=lambda item: item.stamp, default=None)
        first = min(after, key=lambda item: item.stamp, default=None)
        if last and first and first.stamp - last.stamp <= TUNING.longest_gap:
            return _interpolate(last, first, stamp)
        best = min(poses, key=lambda item: abs(item.stamp - stamp), default=None)
        if best is None or abs(best.stamp - stamp) > TUNING.sighting_tolerance:
            return None
        moved = TUNING.speed * abs(best.stamp - stamp)
        return _less_sure(best, moved, moved)

    def knows(self, stamp: float) -> bool:
        """Return whether a pose as new as a stamp [s] has come."""
        return any(item.stamp >= stamp for item in list(self.poses))


def _interpolate(last: TimedPose, first: TimedPose, stamp: float) -> TimedPose:
    """Return the pose between two poses, by time."""
    span = first.stamp - last.stamp
    share = (stamp - last.stamp) / span if span > 0 else 0.0
    step = share * between(last.pose, first.pose)
    between_them = TimedPose(stamp, Pose.from_array(compose(last.pose, step)), last.covariance,
                             last.arrived + share * (first.arrived - last.arrived))
    x, y, theta = between(last.pose, first.pose)
    time = span * min(share, 1.0 - share)     # from the nearer one
    sigma = np.clip(TUNING.uneven * np.abs([np.hypot(x, y), theta]), TUNING.swerve * time,
                    TUNING.speed * time)
    return _less_sure(between_them, *sigma)


def _less_sure(item: TimedPose, sigma_xy: float, sigma_theta: float) -> TimedPose:
    """Add sigmas [m] [rad] to a pose."""
    more = np.diag([sigma_xy, sigma_xy, sigma_theta]) ** 2
    return item._replace(covariance=item.covariance + more)


def same_time(one: TimedPose, other: TimedPose) -> bool:
    """
    Return whether two robots' poses of one stamp are of one time, as far as can be told.

    Both came after as long, unless a clock is ahead, behind or was set, or one came late.
    """
    return bool(_clocks_apart(one, other) <= TUNING.stepped)


def _clocks_apart(one: TimedPose, other: TimedPose) -> float:
    """Return by how much [s] the times may differ of two poses of one stamp; nan if unknown."""
    return abs((one.arrived - one.stamp) - (other.arrived - other.stamp))


def from_sighting(own: TimedPose, T_base_peer: Pose, covariance: Array,
                  peer: TimedPose) -> tuple[Pose, Array]:
    """
    Return T_own_peer of two map frames and its covariance (3, 3).

    From a sighting of the peer in the robot's own base frame, with its covariance, and the poses
    of both robots in their own maps. Where clocks may differ, the peer may have moved meanwhile.
    """
    apart = _clocks_apart(own, peer)
    if apart > 0.0:
        peer = _less_sure(peer, TUNING.speed * apart, TUNING.speed * apart)
    return chained((own.pose, own.covariance), (T_base_peer, covariance),
                   (peer.pose, peer.covariance))
