# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure: where it looks, what it matches, and what it refuses to believe."""

from collections import Counter
from dataclasses import replace
from threading import Lock
from unittest.mock import patch

from helpers import fake_room, fake_scan, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose
from somfusion_ros.slam import loop_matching
from somfusion_ros.slam.checkpoint import ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.ekf import DelayedStateEkf
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loop_closer import LoopCloser
from somfusion_ros.slam.loop_trust import agree, Loop, LoopClosure
from somfusion_ros.slam.loop_trust import TUNING as TRUST
from somfusion_ros.slam.loops import Candidate, candidates, TUNING
from somfusion_ros.slam.scan import cloud

CONFIG = SlamConfig(loop_minimum_gap=5)
ROOM = fake_room()
PLACES = np.array([(1.5, 1.5, 0.3), (2.5, 1.2, -0.4), (2.0, 2.5, 1.0)])
R = np.diag([0.02, 0.02, 0.01]) ** 2


def straight(n: int, sigma: float) -> DelayedStateEkf:
    """Drive n views there and back again over the same floor."""
    ekf = DelayedStateEkf()
    ekf.augment(np.zeros(3), R)
    for k in range(1, n):
        turn = np.pi if k == n // 2 else 0.0
        ekf.augment(np.array([0.5, 0.0, turn]), np.diag([sigma, sigma, 0.1 * sigma]) ** 2)
    return ekf


def test_candidates_are_old_views_near_by():
    ekf = straight(40, 0.01)
    found = candidates(39, ekf, np.zeros((40, 2)), CONFIG)
    ties = [c for c in found if c.old == 39 - TUNING.span]
    assert len(ties) == 1 and 2 <= len(found) <= 3
    for candidate in found:
        assert candidate.old <= 39 - CONFIG.loop_minimum_gap
        assert (candidate in ties
                or np.hypot(*candidate.expected[:2]) < CONFIG.loop_search_distance + 1.0)


def test_an_unsure_view_may_lie_at_other_places_too():
    """Within 4 sigma and a bit; all of them, one each; none where the filter is sure."""
    sure, unsure = (candidates(59, straight(60, sigma), np.zeros((60, 2)), CONFIG)
                    for sigma in (0.01, 0.3))
    assert not any(c.elsewhere for c in sure)
    for candidate in unsure:
        places = np.array([c.old for c in candidate.elsewhere])
        assert 3 <= len(places) <= 30 and places.max() <= 59 - CONFIG.loop_minimum_gap
        for place in candidate.elsewhere:
            assert np.hypot(*place.expected[:2]) < 1.2 + 4.1 * np.hypot(*place.sigma[:2])


def test_an_old_view_is_tried_as_far_away_as_the_filter_is_unsure():
    """It is 6.6 m from where it began: far for a filter that knows it to 1 m, near at 4 m."""
    for sigma, tried in ((0.1, False), (0.5, True)):
        ekf = DelayedStateEkf()
        ekf.augment(np.zeros(3), R)
        for _ in range(39):
            ekf.augment(np.array([0.12, 0.12, 0.0]), np.diag([sigma, sigma, 0.01]) ** 2)
        found = candidates(39, ekf, np.zeros((40, 2)), replace(CONFIG, loop_minimum_gap=38))
        assert any(c.old <= 1 and not c.tie for c in found) == tried


def test_a_new_map_has_no_candidates():
    assert candidates(3, straight(4, 0.01), np.zeros((4, 2)), CONFIG) == []


def clouds_of(places: np.ndarray, room: np.ndarray = ROOM) -> list:
    rng = np.random.default_rng(0)
    return [cloud(fake_scan(room, p, noise=0.01, rng=rng), 30.0) for p in places]


@pytest.mark.parametrize('off, sigma', [((0.8, -0.6, 0.2), (0.4, 0.4, 0.1)),
                                        ((6.0, -4.0, 0.3), (3.0, 2.0, 0.15))])
def test_a_place_is_recognised_from_afar(off, sigma):
    target = LocalMap.of_views(clouds_of(PLACES), list(between(PLACES[0], PLACES)))
    truth = np.array([2.0, 1.8, 0.2])
    expected = between(PLACES[0], truth)
    guess = Candidate(0, expected + off, np.array(sigma))
    loop = loop_matching.match(guess, 9, clouds_of(truth[None])[0], lambda old: target, CONFIG)
    distance, angle = pose_error(loop.constraint.z, expected)
    assert distance < 0.03 and angle < np.radians(1)
    assert loop.agreement > 0.95 and not loop.sure


def test_another_place_is_refused_for_what_it_contradicts():
    """A small room laid into a larger one has its walls where the old views saw free space."""
    target = LocalMap.of_views(clouds_of(PLACES), list(between(PLACES[0], PLACES)))
    other = cloud(fake_scan(fake_room(3.2, 2.4), np.array([1.0, 1.0, 0.5])), 30.0)
    for x in (0.0, 0.5):
        guess = Candidate(0, np.array([x, 0.3, 0.2]), np.array([0.5, 0.5, 0.2]))
        assert loop_matching.match(guess, 9, other, lambda old: target, CONFIG) is None


def test_a_tie_does_not_slide_along_a_round_wall():
    """Views 6 m apart in a smooth round corridor see nothing in common: a loop may be farther."""
    angle = np.linspace(0.0, 2.0 * np.pi, 241)
    rims = [np.column_stack([r * np.cos(angle), r * np.sin(angle)]) for r in (7.0, 9.0)]
    walls = np.concatenate([np.column_stack([rim[:-1], rim[1:]]) for rim in rims])
    places = np.array([(8 * np.cos(a), 8 * np.sin(a), a + np.pi / 2)
                       for a in (0.0, -0.1, 0.1, 0.8)])
    *old, seen = (cloud(fake_scan(walls, p, noise=0.01), 30.0) for p in places)
    target = LocalMap.of_views(old, list(between(places[0], places[:3])))
    guess = Candidate(0, between(places[0], places[3]), np.array([0.8, 0.8, 0.2]))
    anywhere = loop_matching.match(guess, 9, seen, lambda old: target, CONFIG)
    assert anywhere is not None, 'it is sought everywhere'
    tie = replace(guess, tie=True)
    assert loop_matching.match(tie, 9, seen, lambda old: target, CONFIG) is None


@pytest.mark.parametrize('walls, unique', [(len(ROOM), False), (len(ROOM) - 4, True)])
def test_a_view_that_fits_two_places_tells_neither(walls, unique):
    """A second room, 6 m on, is the same; without its pillar it is another."""
    first, second = (LocalMap.of_views(clouds_of(PLACES, room),
                                       list(between(PLACES[0], PLACES)))
                     for room in (ROOM, ROOM[:walls]))
    truth = np.array([2.0, 1.8, 0.2])
    expected, sigma = between(PLACES[0], truth), np.array([2.0, 2.0, 0.1])
    guess = Candidate(0, expected, sigma, elsewhere=(
        Candidate(8, expected - (6.0, 0.0, 0.0), sigma),))
    places = {0: first, 8: second}
    loop = loop_matching.match(guess, 19, clouds_of(truth[None])[0], places.get, CONFIG)
    assert loop.unique == unique


def loop_between(ekf: DelayedStateEkf, i: int, j: int, error: np.ndarray, sure: bool) -> Loop:
    return Loop(Constraint(i, j, compose(ekf.relative(i, j)[0], error), R), 1.0, sure)


def test_a_loop_that_fits_a_sure_filter_is_trusted_at_once():
    ekf = straight(40, 0.01)
    assert LoopClosure().trusted(
        loop_between(ekf, 2, 37, np.array([0.02, 0.0, 0.0]), True), ekf)


def test_a_loop_far_from_expectation_waits_for_partners():
    ekf, error = straight(40, 0.3), np.array([1.5, 1.0, 0.2])
    closure = LoopClosure()
    first = Constraint(2, 35, compose(error, ekf.relative(2, 35)[0]), R)
    others = [Constraint(2, k, compose(error, ekf.relative(2, k)[0]), R) for k in (36, 37)]
    assert closure.trusted(Loop(first, 1.0, False), ekf) == []
    assert closure.trusted(Loop(others[0], 1.0, False), ekf) == []
    assert len(closure.trusted(Loop(others[1], 1.0, False), ekf)) == 3


def test_loops_that_agree_must_span_as_much_travel_as_the_filter_is_unsure():
    """Views are 0.5 m apart: with a sigma of 0.6 m it takes the fifth loop."""
    ekf, closure = straight(40, 0.3), LoopClosure()
    error = np.array([1.5, 1.0, 0.2])
    believed = [len(closure.trusted(Loop(Constraint(
        2, k, compose(error, ekf.relative(2, k)[0]), R), 1.0, False, 0.6), ekf))
        for k in range(31, 37)]
    assert believed == [0, 0, 0, 0, 5, 0]


def test_what_loops_suppose_is_followed_however_far_off_the_filter_is():
    """After a loop of 330 m views were sought where the filter had them, ever farther off."""
    ekf, closure, off = straight(60, 0.3), LoopClosure(), np.array([-6.0, 0.0, 0.0])
    for j in (50, 51, 52):
        assert closure.supposed(j, ekf) is None
        loop = replace(loop_between(ekf, 60 - j, j, off, sure=False), sigma=5.0)
        assert closure.trusted(loop, ekf) == []
    before, after = (candidates(59, ekf, np.zeros((60, 2)), CONFIG, loop)
                     for loop in (None, closure.supposed(59, ekf)))
    assert closure.supposed(52 + TRUST.recent + 1, ekf) is None
    added, = {c.old for c in after} - {c.old for c in before}
    assert abs(added - 13) <= 1     # 6 m from view 1, which the filter has it near
    follows, = (c for c in after if c.old == added)
    assert np.hypot(*follows.expected[:2]) < 0.6
    T_places = [compose(ekf.poses[c.old], c.expected) for c in follows.elsewhere]
    assert len(T_places) > 3 and np.ptp(T_places, axis=0).max() < 1e-9


def test_a_supposed_loop_that_leads_to_no_old_view_is_not_followed():
    """It ends where nothing was seen, or nothing is old enough by its time."""
    ekf, nothing = straight(60, 0.3), np.zeros((60, 2))
    plain = [c.old for c in candidates(59, ekf, nothing, CONFIG)]
    for second, off in ((50, np.array([0.0, 40.0, 0.0])), (3, np.zeros(3))):
        supposed = Constraint(10, second, compose(ekf.relative(10, second)[0], off), R)
        assert [c.old for c in candidates(59, ekf, nothing, CONFIG, supposed)] == plain


def test_an_unsure_loop_outside_the_gate_is_never_trusted():
    """The same as above, with odometry that is six times as good."""
    ekf, closure = straight(40, 0.05), LoopClosure()
    error = np.array([1.5, 1.0, 0.2])
    for k in range(31, 39):
        constraint = Constraint(2, k, compose(error, ekf.relative(2, k)[0]), R)
        assert not closure.trusted(Loop(constraint, 1.0, False, 0.6), ekf)


def test_a_loop_that_fits_elsewhere_is_never_trusted():
    ekf, closure = straight(40, 0.05), LoopClosure()
    for k in range(25, 39):
        loop = replace(loop_between(ekf, 2, k, np.zeros(3), False), unique=False)
        assert not closure.trusted(loop, ekf)


def test_loops_that_contradict_one_another_are_never_trusted():
    ekf, closure = straight(40, 0.05), LoopClosure()
    rng = np.random.default_rng(2)
    for k in range(25, 39):
        error = rng.uniform(-2.0, 2.0, 3)
        assert not closure.trusted(loop_between(ekf, 2, k, error, False), ekf)


def test_agreement_does_not_depend_on_the_order():
    ekf = straight(40, 0.05)
    a = loop_between(ekf, 2, 30, np.array([0.5, 0.3, 0.1]), False).constraint
    b = Constraint(4, 33, compose(compose(between(ekf.poses[4], ekf.poses[2]), a.z),
                                  between(ekf.poses[30], ekf.poses[33])), R)
    assert agree(a, b, ekf)


def test_loops_agree_whichever_is_named_first():
    """What the odometry drifts between them was counted one way only."""
    ekf = straight(60, 0.05)
    a = loop_between(ekf, 2, 30, np.zeros(3), False).constraint
    b = loop_between(ekf, 4, 55, np.array([0.0, 0.3, 0.0]), False).constraint
    assert agree(a, b, ekf) and agree(b, a, ekf)


def test_a_loop_of_a_view_that_was_taken_back_confirms_no_other():
    ekf, closure, error = straight(40, 0.3), LoopClosure(), np.array([1.5, 1.0, 0.2])
    for k in (35, 36, 37):
        loop = Loop(Constraint(2, k, compose(error, ekf.relative(2, k)[0]), R), 1.0, False)
        closure.forget({35})
        assert closure.trusted(loop, ekf) == []


def test_a_view_that_is_taken_back_while_it_is_matched_closes_no_loop():
    graph, lock = ViewGraph(straight(40, 0.01)), Lock()
    closer = LoopCloser(graph, lock, CONFIG, Counter())
    graph.hidden.add(37)
    closer._close(loop_between(graph.ekf, 2, 37, np.zeros(3), True))
    assert not graph.constraints
    closer._close(loop_between(graph.ekf, 2, 38, np.zeros(3), True))
    assert len(graph.constraints) == 1


def test_a_view_that_is_taken_back_meanwhile_is_not_judged(monkeypatch):
    """It shows nothing, and would deny what holds it."""
    graph = ViewGraph(straight(40, 0.01), clouds_of(np.zeros((40, 3))))
    graph.centres, graph.stamps = [np.zeros(2)] * 40, [0.0] * 40
    judged, taken_back = [], set()
    closer = LoopCloser(graph, Lock(), CONFIG, Counter())
    monkeypatch.setattr(closer, '_relinearise', lambda: graph.hidden.update(taken_back))
    monkeypatch.setattr(closer.doubts, 'judge', lambda view, newest: judged.append(view))
    for taken_back in (set(), {39}):
        graph.to_close.append(39)
        assert closer.work()
    assert judged == [39]


def test_a_view_that_is_added_meanwhile_does_not_disturb_a_loop():
    """Which views follow one another is read under the lock, as a scan may add one."""
    graph = ViewGraph(straight(40, 0.01), clouds_of(np.zeros((40, 3))))
    graph.centres, graph.stamps = [np.zeros(2)] * 40, [0.0] * 40
    graph.to_close.append(39)
    lock = Lock()
    with patch.object(DelayedStateEkf, 'begins', property(
            lambda ekf: np.array([0]) if lock.locked() else 1 / 0)):
        assert LoopCloser(graph, lock, CONFIG, Counter()).work()


@pytest.mark.parametrize('hidden', [None, 33, 5])
def test_loops_that_wait_go_with_the_views_that_are_taken_back(hidden: int | None) -> None:
    """What is supposed, and what confirms others, must not come from where the robot was not."""
    ekf, closure = straight(40, 0.3), LoopClosure()

    def loop(first: int, second: int) -> Loop:
        z, P = ekf.relative(first, second)
        return Loop(Constraint(first, second, z, R), 1.0, False, 0.1)

    for first, second in ((5, 33), (4, 34), (3, 35)):
        closure._pending.append(loop(first, second))
    assert closure.supposed(36, ekf) is not None
    closure.forget(set() if hidden is None else {hidden})
    assert (closure.supposed(36, ekf) is None) is (hidden is not None)
    assert len(closure._pending) == (3 if hidden is None else 2)
