# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""With use_peers a robot's own map is shown straightened; the estimate itself stays its own."""

from helpers import fake_scan, fake_trajectory, furnished_room
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose, inverse
from somfusion_ros.slam.bend import Bend, best_rigid
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step
from somfusion_ros.team.joint import solve_joint
from somfusion_ros.team.teller import tell
from test_joint import team

paths = arrays(float, st.tuples(st.integers(2, 12), st.just(3)),
               elements=st.floats(-3.0, 3.0, width=32))


@given(paths, st.tuples(*[st.floats(-9.0, 9.0)] * 3))
def test_it_does_not_matter_where_the_world_lies(own: Array, world: tuple[float, ...]) -> None:
    joint = compose(np.array(world), own)
    assert Bend.of(own, joint).views(own) == pytest.approx(own, abs=1e-6)


@given(paths)
def test_what_is_shown_leads_back(own: Array) -> None:
    joint = own + np.linspace(0.0, 0.2, len(own))[:, None]
    bend = Bend.of(own, joint)
    shown = bend.views(own)
    at = len(own) - 1
    assert bend.pose(at, own[at]) == pytest.approx(shown[at], abs=1e-9)
    seen = bend.bodies(Bodies(shown[at:, :2], 0.3), at)
    assert seen.places[0] == pytest.approx(own[at, :2], abs=1e-9)
    assert bend.pose(99, own[at]) == pytest.approx(shown[at], abs=1e-9)    # a view of later


def test_a_pose_given_by_hand_is_meant_in_the_map_that_is_shown() -> None:
    own = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])
    bend = Bend.of(own, own + np.sin(np.arange(9.0) / 3.0)[:, None] * (0.0, 1.0, 0.0))
    shown = bend.views(own)
    assert bend.undo(shown[5], own) == pytest.approx(own[5], abs=1e-9)


def test_peers_straighten_what_is_shown() -> None:
    robots, matches, world, truth = team()
    solved = solve_joint(robots, matches, world).poses
    for name, true in zip(('a', 'b'), truth, strict=True):
        own = robots[name].poses
        shown = Bend.of(own, solved[name]).views(own)
        off = [np.hypot(*(compose(best_rigid(poses, true), poses) - true)[:, :2].T).max()
               for poses in (own, shown)]
        assert off[1] < 0.5 * off[0]


def drive(slam: Slam) -> list[Step]:
    """Drive through a room."""
    walls, (_, poses) = furnished_room(14.0, 11.0), fake_trajectory(
        np.array([(1.0, 0.7), (9.0, 0.7)]))
    rng = np.random.default_rng(0)
    return [slam.process(fake_scan(walls, pose, stamp=0.2 * k, rng=rng),
                         Odometry(0.2 * k, between(poses[0], pose), np.zeros(3)))
            for k, pose in enumerate(poses[::2])]


def test_only_what_is_shown_is_bent() -> None:
    slam = Slam()
    last = drive(slam)[-1]
    before, told = slam.grid(), tell(slam.checkpoint())
    _, own = slam.views()
    slam.bend = Bend.of(own, own + np.linspace(0.0, 1.0, len(own))[:, None] * (0.0, 0.5, 0.0))
    assert tell(slam.checkpoint()) == told
    assert np.array_equal(slam.views()[1], own)
    bent = slam.grid()
    assert not np.array_equal(bent.evidence, before.evidence)
    shown = slam.bend.step(last)
    assert shown.pose == pytest.approx(compose(
        compose(slam.bend.views(own)[last.view], inverse(own[last.view])), last.pose), abs=1e-9)
    odom = compose(inverse(last.T_map_odom), last.pose)
    assert compose(shown.T_map_odom, odom) == pytest.approx(shown.pose, abs=1e-9)
