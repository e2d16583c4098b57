# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where robots were at one time: a transform that puts two bodies in one place is wrong.

Two ends of a corridor may look alike, and no map tells them apart until one shows a difference.
Bodies do: whoever drives about in the one end is not where the other one drives.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import math
from typing import Any, NamedTuple

import numpy as np
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import Array, between, compose, inverse, Pose
from somfusion_ros.settings import tuned
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.team.heard import Heard, TimedPose
from somfusion_ros.team.members import Team
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.whereabouts import MOST_PLACES, MOST_ROBOTS, Places, Whereabouts

MEETINGS = 100    # of each peer that are kept, the newest
NOWHERE = Outline()
NO_EPOCHS: Mapping[str, Epoch] = {}


@dataclass(frozen=True)
class PresenceTuning:
    """When a transform contradicts where the robots were."""

    lag: float = tuned(
        0.75, 's', 'a pose that is later than this, by the own clock, or from so far in the '
        'future, is of no use: clocks may differ', 'by design')
    apart: float = tuned(
        0.5, 'm', 'a peer that moved by less is where it was', 'by design')
    narrow: float = tuned(
        0.25, 'm', 'the centres of two robots are never nearer', 'by design')
    distinct: float = tuned(
        1.0, 'm', 'between two places that count as two', 'by design')
    proof: int = tuned(
        4, 'places', 'that a transform contradicts, so that it is wrong: at one or two a clock, a '
        'pose, or a laser that missed a thin robot can be. Played together, logs that were '
        'recorded one after the other put no two robots in one place so often',
        'mines, wean, Intel, CSAIL and Belgioioso, each played as a team')
    few: int = tuned(
        2, 'places', 'that are proof where most meetings are at such places', 'by design')
    known: float = tuned(
        0.3, 'm', 'sigma with which it is known where a peer was that is looked for', 'by design')
    nearest: float = tuned(
        0.6, 'm', 'nearer, a laser may look over a body, or its own robot be it', 'by design')
    farthest: float = tuned(
        6.0, 'm', 'farther, beams may pass a thin robot on both sides', 'by design')
    beside: float = tuned(
        0.3, 'm', 'that the body may be off to either side of where it should be', 'by design')
    behind: float = tuned(
        0.5, 'm', 'that beams must see past the place where the body should be', 'by design')
    gap: float = tuned(
        0.15, 'm', 'between two beams that pass; where a body was left out of the scan, they are '
        'wider apart', 'by design')
    probability: float = tuned(
        0.01, '', 'that is left to a verdict that is contradicted', 'by design')


TUNING = PresenceTuning()


class Meeting(NamedTuple):
    """Poses of the own robot and of a peer at one time, each in its map; what each saw then."""

    own: Pose
    peer: Pose
    seen: Outline = NOWHERE
    by_peer: Outline = NOWHERE


class Presence:
    """What one robot knows of where its peers were while it was where."""

    def __init__(self) -> None:
        self._met: dict[str, deque[Meeting]] = {}
        self._places: dict[str, deque[Places]] = {}    # of meetings, a few that are far apart
        self._told: dict[str, Whereabouts] = {}     # by peers
        self._changes = 0     # of all that was noted
        self._answers: dict[str, tuple[Any, int]] = {}    # to what was asked last of a peer
        self._looked: dict[str, int] = {}     # views of each robot that were looked at

    def hear(self, peer: str, item: TimedPose, own: Heard, now: float) -> None:
        """Note where the own robot was when a peer told a pose, where the clocks agree."""
        if abs(own.after(item.stamp, now)) <= TUNING.lag:
            here = own.pose_at(item.stamp)
            if here is not None:
                self.meet(peer, Meeting(here.pose, item.pose))

    def meet(self, peer: str, meeting: Meeting) -> None:
        """Note where both were at one time, where the peer moved or the own robot looked."""
        met = self._met.setdefault(peer, deque(maxlen=MEETINGS))
        if len(meeting.seen.reach) or len(meeting.by_peer.reach) or not met or np.hypot(
                *np.subtract(meeting.peer, met[-1].peer)[:2]) >= TUNING.apart:
            met.append(meeting)
            self._changes += 1
            here, kept = (meeting.own[:2], meeting.peer[:2]), self._places.setdefault(
                peer, deque(maxlen=MOST_PLACES))
            if all(_apart(here, other) for other in kept):
                kept.append(here)

    def believe(self, peer: str, own: str, told: Sequence[Whereabouts]) -> None:
        """Note where a peer says that the own robot was, unless it said more before."""
        for one in told:
            before = self._told.get(peer)
            if one.robot == own and (before is None or before.epochs != one.epochs
                                     or len(one.places) >= len(before.places)):
                self._told[peer] = one
                self._changes += one != before

    def whereabouts(self, own: str, epochs: Mapping[str, Epoch]) -> tuple[Whereabouts, ...]:
        """Return where the own robot was when its peers were where, for them to know."""
        known = sorted({*self._places, *self._told} & epochs.keys()) if own in epochs else []
        return tuple(Whereabouts(peer, (epochs[own], epochs[peer]), (
            *list(self._places.get(peer, ()))[::-1], *self._told_now(peer, own, epochs)
        )[:MOST_PLACES]) for peer in known[:MOST_ROBOTS])

    def _told_now(self, peer: str, own: str, epochs: Mapping[str, Epoch]) -> list[Places]:
        """Return what a peer told of the present maps: where the own robot was, and the peer."""
        told, now = self._told.get(peer), (epochs.get(peer), epochs.get(own))
        return [pair[::-1] for pair in told.places] if told and told.epochs == now else []

    def forget(self, robot: str | None = None) -> None:
        """Forget what was noted of a robot that is gone, or of all, None, in another map."""
        self._changes += 1
        for peer in [*self._met, *self._told] if robot is None else [robot]:
            for record in (self._met, self._places, self._told, self._answers):
                record.pop(peer, None)
        self._looked = {} if robot is None else {
            name: count for name, count in self._looked.items() if name != robot}

    def look(self, views: Mapping[str, ViewSet], own: str, heard: Mapping[str, Heard]) -> None:
        """Note where robots were when others took their views, of which one is the own robot."""
        for robot, seen in views.items():
            first = min(self._looked.get(robot, 0), len(seen))
            self._looked[robot] = len(seen)
            for other in sorted(heard.keys() - {own}) if robot == own else [own]:
                peer = other if robot == own else robot
                if abs(heard[peer].late) <= TUNING.lag:
                    for k in range(first, len(seen)):
                        self._note(peer, seen, k, heard[other], robot == own)

    def _note(self, peer: str, views: ViewSet, k: int, other: Heard, by_own: bool) -> None:
        """Note where the other one of a pair was when one, the own robot or not, took a view."""
        there = other.pose_at(float(views.stamps[k]))
        if there is None or np.trace(there.covariance[:2, :2]) > TUNING.known ** 2:
            return
        here, seen = Pose.from_array(views.poses[k]), views.clouds[k].outline
        self.meet(peer, Meeting(here, there.pose, seen) if by_own else
                  Meeting(there.pose, here, by_peer=seen))

    def contradicted(self, peer: str, T_own_peer: Pose, own: str = '',
                     epochs: Mapping[str, Epoch] = NO_EPOCHS) -> int:
        """
        Return at how many places, if at enough, a transform has bodies where none can be.

        own: name of the own robot, without which nothing counts that peers told.
        """
        asked = self._changes, T_own_peer      # what is noted from here on is looked at next time
        if self._answers.get(peer, ((), 0))[0] != asked:
            told = [Meeting(Pose(*here), Pose(*there))
                    for here, there in self._told_now(peer, own, epochs)]
            self._answers[peer] = asked, _count_contradictions(
                told + list(self._met.get(peer, ())),   # in one step: another thread adds to them
                T_own_peer)
        return self._answers[peer][1]

    def why_not(self, peer: str, found: Alignment, team: Team) -> str:
        """Return why an alignment with a peer cannot be, whatever the maps say; '' if it can."""
        T = found.T_target_source
        if T is None:
            return ''
        if found.accepted and team.seen_elsewhere(peer, found):
            return 'sightings have it elsewhere'
        own_first = team.name < peer
        places = self.contradicted(peer, T if own_first else Pose.from_array(inverse(T)),
                                   team.name, team.epochs)
        return '' if not places else (
            f'at {places} places both robots would be in one place, or one would have seen the '
            'other where nobody was')


def impossible(verdict: Alignment, why: str) -> Alignment:
    """Return a verdict on maps that are alike, where the robots say that it cannot be."""
    return replace(verdict, accepted=False, reason=f'refused: {why}',
                   probability=min(verdict.probability, TUNING.probability))


def _count_contradictions(met: Sequence[Meeting], T_own_peer: Pose) -> int:
    """Count the places, if they are enough, at which a transform has bodies where none are."""
    if not met:
        return 0
    own = np.array([meeting.own for meeting in met])
    there = compose(T_own_peer, np.array([meeting.peer for meeting in met]))
    body, back = between(own, there)[:, :2], between(there, own)[:, :2]
    one_place = np.hypot(*body.T) < TUNING.narrow
    wrong = one_place | [
        _looks_through(meeting.seen, body[k]) or _looks_through(meeting.by_peer, back[k])
        for k, meeting in enumerate(met)]
    enough = (1 if one_place.all() and len(met) > 1 else
              TUNING.few if 2 * np.count_nonzero(wrong) > len(met) else TUNING.proof)
    places = _distinct(np.stack([own[wrong, :2], there[wrong, :2]], axis=1).tolist())
    return places if places >= enough else 0


def _distinct(places: Sequence[Places]) -> int:
    """Count pairs of places of which one at least is far from that of all others."""
    kept: list[Places] = []
    for pair in places:
        if all(_apart(pair, other) for other in kept):
            kept.append(pair)
    return len(kept)


def _apart(pair: Places, other: Places) -> bool:
    """Return whether one place of a pair at least is far from that of another pair."""
    return max(math.dist(*both) for both in zip(pair, other)) >= TUNING.distinct


def _looks_through(seen: Outline, body: Array) -> bool:
    """Tell whether beams passed a place (2,) in the base frame where a body should have been."""
    if not len(seen.reach):
        return False
    ends, body = seen.ends - seen.origin, body - seen.origin
    distance = float(np.hypot(*body))
    if not TUNING.nearest <= distance <= TUNING.farthest:
        return False
    u = body / distance
    along, beside = ends @ u, ends @ [-u[1], u[0]]
    ahead = (along > 0.0) & (seen.reach > 0.0)           # the others tell nothing
    offset = distance * beside[ahead] / along[ahead]     # of a beam from the body's centre
    near = np.abs(offset) < TUNING.beside
    window = np.sort(np.r_[-TUNING.beside, offset[near], TUNING.beside])
    return bool((np.diff(window) < TUNING.gap).all()
                and (seen.reach[ahead][near] > distance + TUNING.behind).all())
