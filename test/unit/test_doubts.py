# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views that little holds: they stay where they agree with what was seen before them, or go."""

from collections import Counter

from helpers import fake_room, fake_scan
import numpy as np
import pytest
from somfusion_ros.geometry import Array, compose
from somfusion_ros.slam.agreement import denies
from somfusion_ros.slam.bridge import Bridge, TUNING
from somfusion_ros.slam.checkpoint import ViewGraph
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.doubts import Doubts
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.relocation_tuning import TUNING as RELOCATION
from somfusion_ros.slam.scan import cloud
from somfusion_ros.slam.view_tuning import TUNING as VIEWS

ROOM, STEP = fake_room(), np.array([0.05, 0.0, 0.02])
START = np.array([1.2, 1.5, 0.3])
R = np.diag([0.002, 0.002, 0.001]) ** 2
KNOWN = VIEWS.known                     # views before the bridge
CARRIED = np.array([1.5, 0.6, 2.0])     # from where the robot seems to be
CUPBOARD = np.array([(3.0, 0.8, 3.0, 2.8), (3.0, 2.8, 3.8, 2.8), (3.0, 0.8, 3.8, 0.8)])


def drive(carried: Array, later: int = 0, more: int = 0) -> ViewGraph:
    """Map a room; from a view on, the robot is carried from where it seems to be."""
    graph, rng, pose = ViewGraph(), np.random.default_rng(3), START
    for k in range(KNOWN + later + TUNING.views + more):
        true = compose(pose, carried) if k >= KNOWN + later else pose
        seen = cloud(fake_scan(ROOM, true, noise=0.01, rng=rng), 30.0)
        graph.add(Constraint(k - 1, k, STEP if k else np.zeros(3), R), seen, float(k))
        pose = compose(pose, STEP)
    return graph


@pytest.mark.parametrize('carried', [np.zeros(3), CARRIED], ids=['true', 'carried'])
def test_a_bridge_is_judged_by_what_hangs_on_it(carried: Array) -> None:
    graph = drive(carried)
    bridge = Bridge(KNOWN, range(KNOWN - 10, KNOWN))
    said = [bridge.denied(new, graph.ekf, graph.clouds) for new in range(KNOWN, graph.ekf.n)]
    assert said[:-1] == [None] * (TUNING.views - 1)    # not before some views are judged
    assert said[-1] is bool(carried.any())


def furnished(carried: Array) -> tuple[ViewGraph, list[MapScan]]:
    """Map a room with a cupboard that is moved away before the bridge; return scans before it."""
    graph, pose = drive(carried), START
    rng, fitted = np.random.default_rng(4), []
    for k in range(KNOWN):
        seen = fake_scan(np.vstack([ROOM, CUPBOARD]), pose, noise=0.01, rng=rng)
        graph.clouds[k] = cloud(seen, 30.0)
        if k >= KNOWN - 4:
            later = cloud(fake_scan(ROOM, pose, noise=0.01, rng=rng), 30.0)
            fitted.append(MapScan(k, np.zeros(3), later.outline))
        pose = compose(pose, STEP)
    return graph, fitted


@pytest.mark.parametrize('carried', [np.zeros(3), CARRIED], ids=['true', 'carried'])
@pytest.mark.parametrize('looked', [True, False])
def test_what_was_seen_to_be_gone_before_a_bridge_does_not_deny_it(
        carried: Array, looked: bool) -> None:
    """In four of five simulated weeks a robot was lost by furniture that had been moved."""
    graph, fitted = furnished(carried)
    bridge = Bridge(KNOWN, range(KNOWN - 10, KNOWN), fitted if looked else ())
    for new in range(KNOWN, graph.ekf.n):
        denied = bridge.denied(new, graph.ekf, graph.clouds)
    assert denied is (bool(carried.any()) or not looked)


@pytest.mark.parametrize('known', [True, False])
def test_scans_after_one_that_hardly_fits_tell_nothing_until_a_view_explains_them(
        known: bool) -> None:
    """A robot that was carried sees what is gone at the place where it seems to be."""
    graph, fitted = furnished(np.zeros(3))
    doubts = Doubts(graph, Counter[str]())
    doubts.follow(False, fitted[0])
    if known:
        doubts.go_on()
    for scan in fitted:
        doubts.follow(True, scan)
    doubts.add(KNOWN, range(KNOWN - 10, KNOWN))
    for new in range(KNOWN, graph.ekf.n):
        doubts.judge(new, new - 2 * KNOWN)
    assert doubts.take_back() is not known


@pytest.mark.parametrize('fell', [0.1, 0.25])
def test_a_scan_that_suddenly_fits_less_makes_the_view_after_it_doubtful(fell: float) -> None:
    """A robot put down at the other end of a hall fitted by 75 % there, and by 99 % before."""
    graph = drive(CARRIED)
    doubts = Doubts(graph, Counter[str]())
    for explained in (0.99, 0.99 - fell, 0.99):
        doubts.follow(True, explained=explained)
    doubts.add(KNOWN, range(KNOWN - 10, KNOWN))
    for new in range(KNOWN, graph.ekf.n):
        doubts.judge(new, new - 2 * KNOWN)
    assert doubts.take_back() is (fell > TUNING.fell)


@pytest.mark.parametrize('turned', [0.2, 1.5])
def test_walls_are_laid_on_one_another_before_what_drifted_is_judged(turned: float) -> None:
    """Among equal rooms a robot whose heading had slipped was lost for 53 s, in its place."""
    graph = drive(np.array([0.0, 0.0, turned]), more=TUNING.soon + 1)
    bridge = Bridge(KNOWN, range(KNOWN - 10, KNOWN))
    for new in range(graph.ekf.n - TUNING.views, graph.ekf.n):
        denied = bridge.denied(new, graph.ekf, graph.clouds)
    assert denied is (turned > 1.0)


@pytest.mark.parametrize('soon', [True, False])
def test_a_map_that_has_drifted_since_must_be_denied_by_more(soon: bool) -> None:
    """In half of Belgioioso 81 % of what was seen again, 12 views later, was where it was."""
    graph = drive(CARRIED)
    newest = graph.ekf.n - 1
    bridge = Bridge(KNOWN if soon else newest - TUNING.soon - 1, range(KNOWN - 10, KNOWN))
    bridge._judged = [(8000, 2000)] * (TUNING.views - 1)
    assert bridge.denied(newest, graph.ekf, graph.clouds) is soon


@pytest.mark.parametrize('bent', [2, TUNING.views])
def test_views_that_a_slip_bent_do_not_deny_what_others_saw_again(bent: int) -> None:
    graph, elsewhere = drive(np.zeros(3)), drive(CARRIED)
    bridge = Bridge(KNOWN, range(KNOWN - 10, KNOWN))
    for new in range(graph.ekf.n - bent, graph.ekf.n):
        graph.clouds[new] = elsewhere.clouds[new]
    said = [bridge.denied(new, graph.ekf, graph.clouds) for new in range(KNOWN, graph.ekf.n)]
    assert sum(against for _, against in bridge._judged) > 0.2 * np.sum(bridge._judged)
    assert said[-1] is (bent == TUNING.views)


def test_a_map_that_denies_itself_denies_no_bridge() -> None:
    """A slip had bent what was seen last before it: all that comes next fits that."""
    graph = drive(CARRIED, more=5)
    said = []
    for first in (KNOWN, KNOWN + 5):
        bridge = Bridge(first, range(first - 10, first))
        for new in range(first, first + TUNING.views):
            denied = bridge.denied(new, graph.ekf, graph.clouds)
        assert sum(against for _, against in bridge._judged) > 0.2 * np.sum(bridge._judged)
        said.append(denied)
    assert said == [True, False]


@pytest.mark.parametrize('weak', [False, True])
def test_views_that_little_holds_are_taken_back_with_all_after_them(weak: bool) -> None:
    graph = drive(CARRIED)
    graph.to_close.clear()
    count = Counter[str]()
    doubts = Doubts(graph, count)
    for new in range(KNOWN, graph.ekf.n):
        doubts.follow(new > KNOWN or not weak)     # what comes next fits the view that was kept
        doubts.add(new, range(KNOWN - 10, KNOWN))
        assert not doubts.take_back()
        assert doubts.about(0) is weak, 'nor may it take the place of a view that was known'
        doubts.judge(new, new - 2 * KNOWN)         # nothing is old enough to deny it view by view
        assert doubts.about(new), 'nothing has confirmed it'
    assert doubts.take_back() is weak
    assert graph.hidden == (set(range(KNOWN, graph.ekf.n)) if weak else set())
    assert count['bridges_denied'] == int(weak)
    assert not doubts.take_back()


def test_a_bridge_that_is_not_judged_yet_hides_no_other() -> None:
    """The first is true and is kept; the robot is carried while it is looked at."""
    graph, count = drive(CARRIED, 2), Counter[str]()
    graph.to_close.clear()
    doubts = Doubts(graph, count)
    for new in range(KNOWN, graph.ekf.n):
        doubts.follow(new not in (KNOWN, KNOWN + 2))
        doubts.add(new, range(KNOWN - 10, new))
        doubts.judge(new, new - 2 * KNOWN)
    assert doubts.take_back()
    assert KNOWN + 2 in graph.hidden


def test_each_bridge_that_stays_is_looked_at_again_once_there_are_views_to_search_for() -> None:
    graph = drive(np.zeros(3), 2)
    doubts = Doubts(graph, Counter[str]())
    for new in range(KNOWN, graph.ekf.n):
        doubts.follow(new not in (KNOWN, KNOWN + 2))
        doubts.add(new, range(KNOWN - 10, new))
        doubts.judge(new, new - 2 * KNOWN)
    for first in (KNOWN, KNOWN + 2):
        while graph.ekf.n < first + RELOCATION.views_least:
            assert doubts.take_held() is None, 'so few are not searched for'
            n = graph.ekf.n
            graph.add(Constraint(n - 1, n, STEP, R), graph.clouds[-1], float(n))
        bridge = doubts.take_held()
        assert bridge is not None and bridge.first == first
    assert doubts.take_held() is None


def test_a_bridge_that_was_taken_back_meanwhile_is_not_denied_again() -> None:
    """The second look takes a while; what came since may hang at its place."""
    graph, count = drive(CARRIED), Counter[str]()
    doubts, bridge = Doubts(graph, count), Bridge(KNOWN, range(KNOWN))
    doubts.deny(bridge)
    assert doubts.take_back()
    doubts.deny(bridge)
    assert not doubts.take_back()


def test_a_new_map_has_nothing_to_take_back() -> None:
    """Before a map is worth coming back to, a view that little holds is a guess like any other."""
    graph, count = drive(CARRIED), Counter[str]()
    doubts = Doubts(graph, count)
    doubts.follow(False)
    doubts.add(KNOWN - 1, range(3))
    for new in range(KNOWN, graph.ekf.n):
        doubts.judge(new, 0)
    assert not doubts.take_back() and not count['bridges_denied']


def test_few_points_neither_deny_nor_agree() -> None:
    graph = drive(np.zeros(3))
    around = LocalMap.of_views(graph.clouds[:3], list(graph.ekf.poses[:3]))
    seen = cloud(fake_scan(ROOM, START, noise=0.01, rng=np.random.default_rng(1)), 30.0)
    assert denies(np.zeros(3), seen, around) is False
    assert denies(CARRIED, seen, around) is True
    assert denies(np.array([50.0, 0.0, 0.0]), seen, around) is None


def test_where_all_is_taken_back_by_hand_no_bridge_is_judged_any_more() -> None:
    """So a map that is only tracked in forgets the views of the robot's own."""
    graph = drive(CARRIED)
    doubts = Doubts(graph, Counter[str]())
    doubts.follow(False)
    doubts.add(KNOWN, range(KNOWN))
    assert doubts.about(0)
    doubts.clear()
    assert not doubts.about(0)
    for new in range(KNOWN, graph.ekf.n):
        doubts.judge(new, new - 2 * KNOWN)
    assert not doubts.take_back() and doubts.take_held() is None
