# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Bent maps of one place become one map; those of different places stay as they are."""

from functools import cache

from helpers import fake_scan, fake_trajectory, furnished_room
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose, Pose
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import cloud
from somfusion_ros.team.bond import weakest_direction
from somfusion_ros.team.bonding import rival_of
from somfusion_ros.team.confirming import confirm, ConfirmSettings
from somfusion_ros.team.elastic import ElasticTeam, straighten
from somfusion_ros.team.inter_matching import MatchingSettings, Placed
from somfusion_ros.team.joint_drawing import JointDrawing
from somfusion_ros.team.joint_map import along, draw_joint, Held
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_set import ViewSet

pytestmark = pytest.mark.slow

SIZE = (14.0, 11.0)
ROUND = np.array([(1.0, 0.7), (12.5, 0.7), (12.5, 5.2), (6.5, 5.4), (1.0, 5.2), (1.0, 1.5)])
SIGMA = np.diag([0.01, 0.01, 0.006])      # [m] [m] [rad] of a step between views
CORRIDOR = np.array([(0.0, 0.0, 60.0, 0.0), (60.0, 2.0, 0.0, 2.0)])


def drive(walls: Array, waypoints: Array, bias: float, start: float = 0.0
          ) -> tuple[ViewSet, Array]:
    """Make views of a robot whose heading drifts by bias [rad] per view; and their true poses."""
    rng = np.random.default_rng(round(1e6 * abs(bias)))
    _, path = fake_trajectory(waypoints)
    truth = path[::8]                         # 0.4 m apart
    steps = between(truth[:-1], truth[1:]) + (0.0, 0.0, bias)
    chain, poses = [], [np.zeros(3)]
    for k, step in enumerate(steps):
        chain.append(Constraint(k, k + 1, step, SIGMA ** 2))
        poses.append(compose(poses[-1], step))
    clouds = [cloud(fake_scan(walls, pose, beams=181, range_max=6.0, noise=0.01, rng=rng), 6.0)
              for pose in truth]
    stamps = start + 0.8 * np.arange(len(truth))
    return ViewSet(stamps, np.array(poses), clouds, chain), truth


@cache
def bent_team() -> tuple[dict[str, ViewSet], dict[str, Array], dict[str, Pose]]:
    """Two robots in one room, bent apart; their true paths, and where the maps lie at best."""
    walls = furnished_room(*SIZE)
    views, truth = {}, {}
    for name, waypoints, bias in (('robot1', ROUND, 0.003), ('robot2', ROUND[::-1], 0.004)):
        views[name], truth[name] = drive(walls, waypoints, bias)
    middle = len(truth['robot2']) // 2
    near = int(np.argmin(np.hypot(*(truth['robot1'] - truth['robot2'][middle])[:, :2].T)))
    T = compose(compose(views['robot1'].poses[near],
                        between(truth['robot1'][near], truth['robot2'][middle])),
                between(views['robot2'].poses[middle], np.zeros(3)))
    return views, truth, {'robot1': Pose(), 'robot2': Pose.from_array(T)}


@cache
def straightened() -> ElasticTeam:
    """Solve the bent team."""
    views, _, world = bent_team()
    return straighten(views, world)


def apart(poses: dict[str, Array], truth: dict[str, Array]) -> Array:
    """Distances [m] by which robots lie wrong to one another, wherever they were near."""
    a, b = truth['robot1'], truth['robot2']
    near = [(int(np.argmin(np.hypot(*(a - pose)[:, :2].T))), k) for k, pose in enumerate(b)]
    i, j = np.array([(i, k) for i, k in near if np.hypot(*(a[i] - b[k])[:2]) < 1.0]).T
    off = between(poses['robot1'][i], poses['robot2'][j]) - between(a[i], b[j])
    return np.hypot(*off[:, :2].T)


def test_bent_maps_become_one() -> None:
    views, truth, world = bent_team()
    rigid = {name: compose(world[name], views[name].poses) for name in views}
    assert apart(rigid, truth).max() > 0.5
    team = straightened()
    assert apart(team.poses, truth).mean() < 0.03
    bond, = team.bonds
    assert bond.holds, bond.reason
    assert bond.before < 0.7
    assert bond.after > 0.95
    assert bond.bend > 0.3
    assert 'views confirm' in bond.reason


def test_the_first_map_stays_where_it_is() -> None:
    views, _, _ = bent_team()
    poses = straightened().poses['robot1']
    assert np.mean(poses[:, :2] - views['robot1'].poses[:, :2], axis=0) == pytest.approx(
        np.zeros(2), abs=0.02)


def test_the_order_of_the_robots_does_not_matter() -> None:
    views, _, world = bent_team()
    again = straighten(dict(reversed(views.items())), dict(reversed(world.items())))
    for name, poses in straightened().poses.items():
        assert np.array_equal(poses, again.poses[name])


def test_a_different_place_is_not_bent_into_this_one() -> None:
    views, _, world = bent_team()
    stranger, _ = drive(furnished_room(*SIZE, seed=11), ROUND, 0.001)
    team = straighten({'robot1': views['robot1'], 'robot2': stranger}, world)
    bond, = team.bonds
    assert not bond.holds
    rigid = compose(np.array(world['robot2']), stranger.poses)
    assert team.poses['robot2'] == pytest.approx(rigid, abs=1e-3)


def test_views_far_from_the_truth_do_not_confirm() -> None:
    views, truth, _ = bent_team()
    right = [Placed(name, views[name], truth[name]) for name in ('robot1', 'robot2')]
    wrong = [right[0], Placed('robot2', views['robot2'], truth['robot2'] + (1.2, 0.7, 0.0))]
    rules = ConfirmSettings(), MatchingSettings(), SlamConfig()
    assert confirm(*right, *rules).share > 0.9
    assert confirm(*wrong, *rules).share < 0.3


def test_a_corridor_does_not_confirm() -> None:
    one, truth = drive(CORRIDOR, np.array([(20.0, 1.0), (30.0, 1.0)]), 0.0)
    other, _ = drive(CORRIDOR, np.array([(22.0, 1.1), (32.0, 1.1)]), 0.0)
    placed = Placed('robot1', one, truth), Placed('robot2', other, truth + (0.0, 0.1, 0.0))
    found = confirm(*placed, ConfirmSettings(), MatchingSettings(), SlamConfig())
    assert found.asked > 5
    assert found.share < 0.5


def test_the_weakest_direction_is_that_of_a_corridor() -> None:
    along_x = np.diag([1.0, 0.02, 0.01]) ** 2
    poses = np.column_stack([np.arange(20.0), np.ones(20), np.zeros(20)])
    matches = [InterMatch('a', k, 'b', k, np.zeros(3), along_x) for k in range(16)]
    nothing = np.zeros((3, 3))
    assert weakest_direction(matches, poses, nothing) == pytest.approx(0.25, rel=0.02)
    assert weakest_direction([], poses, nothing) == np.inf


def test_a_path_follows_its_views() -> None:
    views, _, _ = bent_team()
    own, team = views['robot1'], straightened()
    held = Held(own.stamps, np.arange(len(own)))
    at_views = along(own.stamps, own.poses, held, own.poses, team.poses['robot1'])
    assert at_views == pytest.approx(team.poses['robot1'], abs=1e-9)
    dense = np.linspace(own.stamps[0], own.stamps[-1], 2000)
    path = np.column_stack([np.interp(dense, own.stamps, column)
                            for column in (*own.poses[:, :2].T, np.unwrap(own.poses[:, 2]))])
    placed = along(dense, path, held, own.poses, team.poses['robot1'])
    steps = np.hypot(*np.diff(placed[:, :2], axis=0).T)
    assert steps.max() < 0.05       # no jump where one view hands over to the next


def test_what_was_taken_away_is_cleared_whoever_saw_it_last() -> None:
    """The robot that came later decides, also where it sorts first."""
    walls = furnished_room(*SIZE)
    post = np.array([(6.0, 0.4, 6.2, 0.4), (6.2, 0.4, 6.2, 0.6), (6.2, 0.6, 6.0, 0.6),
                     (6.0, 0.6, 6.0, 0.4)])
    way = np.array([(2.0, 1.0), (9.0, 1.0)])
    later, truth = drive(walls, way, 0.0, start=1000.0)
    before, _ = drive(np.concatenate([walls, post]), way, 0.0)
    drawn = draw_joint({'a': later, 'b': before}, {'a': truth, 'b': truth}, 0.05)
    alone = draw_joint({'b': before}, {'b': truth}, 0.05)
    on_post = np.array([(6.02, 0.5), (6.1, 0.58)])
    cells = tuple(alone.point_to_cell(on_post).T)
    assert alone.evidence[cells].min() < 0.0
    assert drawn.evidence[tuple(drawn.point_to_cell(on_post).T)].min() > 0.0


def test_late_words_are_drawn_at_once_and_in_their_order_at_leisure() -> None:
    views, truth, _ = bent_team()
    now = [0.0]

    def clock() -> float:
        now[0] += 1.0      # all takes its time
        return now[0]

    drawing, whole = JointDrawing(0.05, 10.0, clock), draw_joint(views, truth, 0.05)
    first = {'robot1': truth['robot1'], 'robot2': truth['robot2'][:20]}
    drawing.draw(views, first)
    late = dict(truth)
    at_once = drawing.draw(views, late)
    assert at_once.grid.known.sum() >= 0.99 * whole.known.sum()
    while drawing.draw(views, late) is at_once:
        assert now[0] < 100.0
    assert np.array_equal(drawing.draw(views, late).grid.evidence, whole.evidence)
    assert drawing.draw(views, late) is drawing.draw(views, late)


def test_a_rival_that_bends_into_the_same_place_is_none() -> None:
    views, truth, world = bent_team()
    bond, = straightened().bonds
    near = Pose.from_array(compose(np.array(world['robot2']), (0.3, 0.2, 0.05)))
    far = Pose.from_array(compose(np.array(world['robot2']), (4.0, -3.0, 2.0)))
    assert rival_of(bond, views, near) is None
    elsewhere = rival_of(bond, views, far)
    assert elsewhere is not None
    assert not elsewhere.holds
