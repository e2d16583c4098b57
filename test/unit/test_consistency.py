# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Short forms of the studies in benchmarks, systematic errors, and determinism."""

from pathlib import Path

from benchmarks.slam.covariance import consistency
from benchmarks.slam.look_alikes import look_alike_trial
from helpers import write_fake_bag
import numpy as np
import pytest
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.offline.robot_run import run_robot
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import office
from somfusion_ros.simulation.laser import Scene
from somfusion_ros.simulation.trial import run_trial, SICK, simulate_trial

pytestmark = pytest.mark.slow


def test_the_covariance_is_neither_too_small_nor_too_large() -> None:
    """
    Three drives at five moments: 45 degrees of freedom, if the moments were independent.

    The band of 0.5 to 6 about the expected 3 is wide; the study of 50 drives narrows it down.
    """
    mean = np.mean([nees for _, nees, _ in consistency(range(6, 15, 4))])
    assert 0.5 < mean < 6.0


@pytest.mark.parametrize('number, farthest', [(0, 0.4), (1, 0.6), (2, 0.6), (4, 1.0)])
def test_places_that_look_alike_are_not_joined(number: int, farthest: float) -> None:
    """
    Rooms nearly alike, equal rooms, a building that is the same turned by 180 degrees.

    The last is a loop of 100 m that closes among equal alcoves: after the drive it is closed.
    """
    _, found, outcome = look_alike_trial(number)
    assert outcome.distance.max() < farthest
    assert found['believed false'] == 0
    assert found['believed true'] > 0


def test_equal_niches_are_not_joined() -> None:
    """Round a corridor nothing but equal niches tells the place: better lost than wrong."""
    _, found, _ = look_alike_trial(8)
    assert found['found false'] > 0
    assert found['believed false'] == 0


@pytest.mark.parametrize('radius, separation', [(1.03, 1.0), (0.97, 1.0), (1.0, 1.03),
                                                (1.0, 0.97)])
def test_wheels_wrong_by_3_percent_are_estimated(radius: float, separation: float) -> None:
    """Scales of travel and turn within 3 of the filter's sigmas, and within 1.5 percent."""
    nominal = drive.NOMINAL
    wheels = drive.Wheels(nominal.left * radius, nominal.right * radius,
                          nominal.separation * separation)
    plan = office()
    stamps, poses = drive.follow(plan.route(0)[:12], -0.9, 0.5, 60.0)
    trial = simulate_trial(lambda t: Scene(plan.segments), stamps, poses, SICK,
                           np.random.default_rng(7), wheels, slip=0.005)
    out = run_trial(trial)
    c = out.slam._map.tracker.calibration
    for estimate, sigma, true in (
            (c.travelling[0], np.sqrt(c.P_travelling[0, 0]), radius - 1.0),
            (c.turning[1], np.sqrt(c.P_turning[1, 1]), radius / separation - 1.0)):
        assert abs(estimate - true) < 3.0 * sigma
        assert abs(estimate - true) < 0.015
        assert 1e-4 < sigma < 0.03
    assert out.distance.max() < 0.12


def test_the_same_bag_gives_the_same_result_bit_for_bit(tmp_path: Path) -> None:
    write_fake_bag(tmp_path / 'bag', every=3)
    first, second = (run_robot(open_log(tmp_path / 'bag')) for _ in range(2))
    np.testing.assert_array_equal(first.poses, second.poses)
    np.testing.assert_array_equal(first.views, second.views)
    np.testing.assert_array_equal(first.grid.evidence, second.grid.evidence)
