# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that drives on and on in one place: its map stays small, and follows what changes."""

from dataclasses import replace

from helpers import pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.grid import Grid
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box, polygon
from somfusion_ros.simulation.laser import Scene
from somfusion_ros.simulation.trial import SICK, simulate_trial
from somfusion_ros.slam.map_scans import TUNING
from somfusion_ros.slam.mapping import Mapper, place
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.trail import MOST, Trail

pytestmark = pytest.mark.slow

WALLS = [polygon([(0, 0), (9, 0), (9, 6), (0, 6)]), box(4.5, 3.0, 2.0, 1.0),
         box(0.3, 4.0, 0.6, 1.2),
         box(8.0, 0.4, 1.0, 0.8)]
CHAIR, TABLE = (6.5, 5.3), (2.5, 0.6)     # removed; new
ROUND = np.array([(1.5, 1.5), (7.5, 1.5), (7.5, 4.5), (1.5, 4.5), (1.5, 1.5)])
START = np.array([1.5, 1.5, 0.0])


class Rounds:
    """One robot that drives round after round."""

    def __init__(self) -> None:
        self.slam, self._odometry, self._clock = Slam(), np.zeros(3), 0.0
        self._rng = np.random.default_rng(5)
        self._place, self._heading = START[:2], 0.0
        self.sizes: list[tuple[int, int]] = []    # views and scans, and maps before, by part
        self.maps: list[Grid] = []

    @property
    def truth(self) -> Array:
        """True pose (3,) of the robot in the room."""
        return np.array([*self._place, self._heading])

    def turn_by_hand(self) -> None:
        """Put the robot to where it began."""
        self._place, self._heading = START[:2], 0.0

    def drive(self, furniture: tuple[float, float], rounds: int) -> None:
        """Drive rounds beside a piece of furniture."""
        scene = Scene(np.concatenate([*WALLS, box(*furniture, 0.6, 0.6)]))
        way = np.concatenate([self._place[None]] + [ROUND[1:]] * rounds)
        stamps, poses = drive.follow(way, self._heading, 0.6, 60.0 * rounds)
        trial = simulate_trial(lambda t: scene, stamps, poses, SICK, self._rng)
        begin = self._odometry
        for scan in trial.scans[::2]:
            at = drive.at(trial.odometry_stamps, trial.odometry, np.array([scan.stamp]))[0]
            self._odometry = compose(begin, between(trial.odometry[0], at))
            stamp = self._clock + scan.stamp
            self.slam.process(replace(scan, stamp=stamp),
                              Odometry(stamp, self._odometry, np.zeros(3)))
        self._clock += stamps[-1] + 1.0
        self._place, self._heading = poses[-1, :2], float(poses[-1, 2])


def evidence_of(grid: Grid, furniture: tuple[float, float]) -> Array:
    """Evidence of the cells around a piece of furniture [m]."""
    middle = between(START, (*furniture, 0.0))[:2]
    points = grid.points(np.ones(grid.shape, bool))
    near = (np.abs(points - middle) < 0.4).all(1)
    return grid.evidence.ravel()[near]


@pytest.fixture(scope='module')
def rounds() -> Rounds:
    """Drive four rounds, four more, and four after the furniture was moved."""
    made = Rounds()
    for furniture in (CHAIR, CHAIR, TABLE):
        made.maps.append(made.slam.grid())
        made.drive(furniture, 4)
        made.sizes.append((len(made.slam.views()[0]), len(made.slam.checkpoint().scans)))
    return made


def test_more_rounds_add_few_views_and_scans_and_changes_add_some(rounds: Rounds) -> None:
    first, second, changed = np.array(rounds.sizes)
    assert rounds.slam.counters['places_known'] > 50
    assert second[0] < 1.3 * first[0]            # twice the way
    assert changed[0] < 1.8 * first[0]
    checkpoint = rounds.slam.checkpoint()
    showing = sum(len(cloud) > 0 for cloud in checkpoint.clouds)
    assert showing < 1.05 * second[0]            # new views take the place of old ones
    squares = np.floor(place(checkpoint.scans, checkpoint.poses)[:, :2] / TUNING.square)
    _, counts = np.unique(squares, axis=0, return_counts=True)
    assert counts.max() <= 1.5 * TUNING.kept * 4     # ways through a square; poses move a little


@pytest.mark.parametrize('anew', [False, True], ids=['as drawn on the way', 'drawn anew'])
def test_what_was_removed_is_cleared_and_what_is_new_is_drawn(rounds: Rounds, anew: bool) -> None:
    assert (evidence_of(rounds.maps[2], CHAIR) < -0.5).sum() > 10
    assert not (evidence_of(rounds.maps[2], TABLE) < -0.3).any()
    checkpoint = rounds.slam.checkpoint()
    grid = (Mapper(0.05).render(checkpoint.scans, checkpoint.poses) if anew
            else rounds.slam.grid())
    assert (evidence_of(grid, CHAIR) < -0.3).mean() < 0.02
    assert (evidence_of(grid, TABLE) < -0.5).sum() > 10


def test_a_robot_that_is_turned_by_hand_at_a_corner_takes_back_what_it_then_believed() -> None:
    made = Rounds()
    made.drive(CHAIR, 4)
    views = made.slam.views()[1]
    made.turn_by_hand()                 # the odometry does not notice it; the corner looks alike
    made.drive(CHAIR, 4)
    assert len(made.slam.found) == 1
    metres, radians = pose_error(made.slam.driven()[1][-1], between(START, made.truth))
    assert metres < 0.3      # it drove on for up to 0.4 s after the last scan
    assert radians < 0.3
    assert np.abs(made.slam.views()[1][:len(views)] - views).max() < 0.05


def test_a_trail_is_thinned_and_its_newest_part_is_whole() -> None:
    trail = Trail(np.column_stack([np.arange(MOST), np.zeros((MOST, 4))]))
    for k in range(MOST, MOST + 1000):
        trail.append(float(k), 0, np.zeros(3))
    assert len(trail) <= MOST
    assert trail.stamps[-1] == MOST + 999
    assert trail.before == np.count_nonzero(trail.stamps < MOST)    # of an earlier run
    assert (np.diff(trail.stamps) > 0).all()
    assert (np.diff(trail.stamps[-MOST // 3:]) == 1.0).all()
