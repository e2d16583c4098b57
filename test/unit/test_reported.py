# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A fault that nobody reports is a failure, too: for every kind, who says what of it."""

from collections.abc import Iterator
from fnmatch import fnmatch
from functools import cache

import numpy as np
import pytest
from somfusion_ros.simulation.chaos import campaign, striking
from somfusion_ros.simulation.chaos.campaign import Team
from somfusion_ros.simulation.chaos.faults import Fault, KINDS
from test_chaos import matching, tapes

pytestmark = pytest.mark.slow

EPISODE = 100.0      # [s]; drives end after 30 s
FIRST = 12.0         # [s] of a fault, once all have a first map,
LATER = {'kidnapped': 45.0}     # or once pairs are accepted
LASTS = 40.0         # [s]
DRIFT = 0.25         # of clocks: poses are told for 18 s after, in which it must be a second
SILENT = 25.0        # [s] from which on a peer is silent; states are repeated every 10 to 18 s
NEW_MAP = 'word', 'robot2 began another map *'
GONE = 'silent', 'robot2'
LEFT_OUT = 'left out', '* (match) contradicts *'
# Where a fault of robot2, or of a liar, is said, and what. Counts and words are those of fusion
# nodes; slam: what the SLAM itself counts; left out: why a pair is.
REPORTED = {
    'loss': ('count', 'pose_of_*_late'), 'delay': ('count', 'pose_of_robot2_late'),
    'slow link': ('count', 'pose_of_robot2_late'), 'doubling': ('count', 'state_of_robot2_late'),
    'cut': GONE, 'fusion crash': GONE, 'robot off': GONE,
    'slam restart elsewhere': NEW_MAP, 'slam restart without state': NEW_MAP, 'reset': NEW_MAP,
    'carried off and found': NEW_MAP, 'kidnapped': LEFT_OUT,
    'clock step': ('count', 'clock_of_robot2_ahead'),
    'clock drift': ('count', 'clock_of_robot2_ahead'),
    'slam restart with state': ('count', 'slam_of_robot2_restarted'),
    'disk flips bits': ('slam', 'state_*'), 'disk tears a write': ('slam', 'state_*'),
    'disk is full': ('slam', 'state_not_saved'),
    'liar: garbage': ('count', 'state_of_?liar0_unusable'),
    'liar: wrong pairs': LEFT_OUT,
    'liar: ghosts': ('count', 'state_of_?liar0_names_strangers'),
    'liar: absent robots': ('count', '?liar0_does_not_hear_us'),
    'liar: walls': ('count', 'map_of_?liar0_unusable'),
    'liar: free everywhere': LEFT_OUT,
    'liar: replay': ('count', 'state_of_?liar0_late'),
    'liar: flicker': ('word', '?liar0 began another map *'),
    'liar: poses': ('count', 'pose_of_?liar0_unusable'),
    'liar: views': ('count', 'views_of_?liar0_unusable'),
    'liar: bonds': LEFT_OUT}
ALSO = {'liar: wrong pairs': ('count', 'joined_by_?liar0_alone')}


def said(team: Team, now: float) -> Iterator[tuple[str, str]]:
    """Yield what is said at a time [s]."""
    for robot in team.robots.values():
        yield from (('slam', name) for name, count in robot.counts.items() if count)
        station = robot.station
        if station is None:
            continue
        yield from (('count', name) for name, count in station.counts.items() if count)
        yield from (('word', word) for word in station.words)
        yield from (('left out', dropped.reason)
                    for dropped in station.session.snapshot.solution.dropped)
        yield from (('silent', name) for name, heard in station.inbox.heard.items()
                    if SILENT < robot.clock.steady(now) - heard.at < np.inf)


def run(faults: list[Fault]) -> frozenset[tuple[str, str]]:
    """Return all that is said in a team of three with some faults."""
    found: set[tuple[str, str]] = set()
    with pytest.MonkeyPatch.context() as patch:
        step = Team._step

        def looked(team: Team, now: float) -> None:
            step(team, now)
            found.update(said(team, now))
        patch.setattr(campaign, 'EPISODE', EPISODE)
        patch.setattr(campaign, 'EPISODES', 1)
        patch.setattr(striking, 'DRIFT', DRIFT)
        patch.setattr(Team, '_step', looked)
        outcome = Team(2, faults, tapes(), matching()).run()
    assert not outcome.broken
    return frozenset(found)


@cache
def quiet() -> frozenset[tuple[str, str]]:
    """Return all that is said where nothing fails."""
    return run([])


def test_every_kind_is_in_the_table() -> None:
    assert {*REPORTED} == {*KINDS}


@pytest.mark.parametrize('kind', REPORTED)
def test_who_says_what_of_a_fault(kind: str) -> None:
    for said, expected in ((run([Fault(LATER.get(kind, FIRST), kind, 'robot2', LASTS, 0.99)]),
                            True), (quiet(), False)):
        for where, pattern in {REPORTED[kind], ALSO.get(kind, REPORTED[kind])}:
            assert expected == any(place == where and fnmatch(text, pattern)
                                   for place, text in said), f'{pattern} of {kind}'


def test_nobody_is_suspected_where_nothing_fails() -> None:
    assert not [text for _, text in quiet() for pattern in (
        'joined_by_*', 'bonds_of_*', '*_contradicts_absent', 'initial_pose_of_*')
        if fnmatch(text, pattern)]
