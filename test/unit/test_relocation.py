# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A robot that is carried, kidnapped or started anywhere finds itself in the map that it has."""

from dataclasses import replace

from helpers import pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.offline.robot_run import ended_lost
from somfusion_ros.simulation import drive, floor_plan
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import run_trial, SICK, simulate_trial, Trial
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.grid_views import grid_checkpoint
from somfusion_ros.slam.matching import Match
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.relocation import Placed
from somfusion_ros.slam.relocation_tuning import TUNING
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.start import Start
from somfusion_ros.slam.step import Step

pytestmark = pytest.mark.slow

PLAN = floor_plan.office()
SPARSE = Laser(181, np.pi, 0.1, 12.0, 0.4, mount=Pose(0.2, 0.0, 0.0))
FOUND_WITHIN = 10.0                    # [m] of driving
METRES, RADIANS = 0.1, np.radians(1.0)   # off the truth once found
ROUND = Laser(360, 2.0 * np.pi, 0.1, 12.0, 0.2, mount=Pose(0.2, 0.0, 0.0))
# Through the corridor and two rooms; the second way is another robot's.
FIRST = [(1.5, 5.2), (14.2, 5.2), (14.2, 8.0), (14.2, 5.2), (5.4, 5.2), (5.4, 8.0), (5.4, 5.2),
         (4.4, 5.2), (4.4, 2.5), (4.4, 5.2), (2.0, 5.2)]
SECOND = [(14.2, 8.0), (14.2, 5.2), (5.4, 5.2), (5.4, 8.0)]
# As the second, but through two rooms that the first did not see.
OUTSIDE = [*SECOND[:2], (11.3, 5.2), (11.3, 8.0), (9.8, 8.0), (11.3, 8.0), (11.3, 5.2),
           (7.4, 5.2), (7.4, 2.5), (9.5, 2.5), (7.4, 2.5), (7.4, 5.2), *SECOND[2:]]


def trial(way: list[tuple[float, float]], heading: float, seed: int,
          plan: floor_plan.FloorPlan = PLAN) -> Trial:
    """Drive along way points."""
    rng = np.random.default_rng(seed)
    stamps, poses = drive.follow(np.array(way), heading, 0.6, 400.0)
    scene = Scene(plan.segments)
    return simulate_trial(lambda t: scene, stamps, poses, SICK, rng,
                          drive.real_wheels(0.02, rng))


def run(slam: Slam, drawn: Trial, start: Array, later: float = 0.0,
        odometry_start: Array | None = None) -> list[tuple[Step, Array]]:
    """Feed every other scan; return the steps, and the true poses seen from the start (3,)."""
    made, begin = [], np.zeros(3) if odometry_start is None else odometry_start
    for scan in drawn.scans[::2]:
        at = drive.at(drawn.odometry_stamps, drawn.odometry, np.array([scan.stamp]))[0]
        pose = compose(begin, between(drawn.odometry[0], at))
        stamp = scan.stamp + later
        step = slam.process(replace(scan, stamp=stamp), Odometry(stamp, pose, np.zeros(3)))
        made.append((step, compose(start, drawn.truth(np.array([scan.stamp]))[0])))
    return made


T_FIRST, T_SECOND = np.array([*FIRST[0], 0.0]), np.array([*SECOND[0], -np.pi / 2])
IN_MAP = between(T_FIRST, T_SECOND)    # where the second drive starts in the first one's map


@pytest.fixture(scope='module')
def mapped() -> tuple[Checkpoint, Slam]:
    """Map by the first drive."""
    slam = Slam()
    run(slam, trial(FIRST, 0.0, 1), np.zeros(3))
    return slam.checkpoint(), slam


def assert_found(slam: Slam, steps: list[tuple[Step, Array]], times: int = 1,
                 radians: float = RADIANS) -> None:
    """Assert that the robot was found soon, and is where it is from then on."""
    assert len(slam.found) == times
    assert slam.found[-1].metres < FOUND_WITHIN
    after = [(step, truth) for step, truth in steps if step.stamp > slam.found[-1].stamp]
    assert len(after) > 20
    errors = np.array([pose_error(step.pose, truth) for step, truth in after])
    assert (np.percentile(errors, 95, axis=0) < (METRES, radians)).all()


def test_a_robot_that_was_carried_away_is_found_and_its_map_grows_on(
        mapped: tuple[Checkpoint, Slam]) -> None:
    checkpoint, _ = mapped
    slam = Slam(checkpoint=checkpoint, start=Start(anywhere=True))
    steps = run(slam, trial(SECOND, -np.pi / 2, 2), IN_MAP)
    assert_found(slam, steps)
    views = slam.views()[1]
    assert np.abs(views[:len(checkpoint.poses)] - checkpoint.poses).max() < 0.05
    lost = [step for step, _ in steps if step.reason == 'lost']
    assert lost
    assert all(step.covariance[0, 0] > 1.0 for step in lost)   # it does not claim to know
    driven = slam.driven()
    assert len(driven[0]) == len(steps)                        # the piece was joined
    assert pose_error(driven[1][0], IN_MAP)[0] < METRES


def test_a_kidnapped_robot_notices_it_and_is_found(mapped: tuple[Checkpoint, Slam]) -> None:
    slam, first = Slam(), trial(FIRST, 0.0, 3)
    before = run(slam, first, np.zeros(3))
    assert not slam.lost
    views = slam.views()[1]
    carried = trial(SECOND, -np.pi / 2, 4)      # the odometry does not notice it
    steps = run(slam, carried, IN_MAP, later=before[-1][0].stamp + 1.0,
                odometry_start=between(first.odometry[0], first.odometry[-1]))
    assert_found(slam, steps)
    assert len(slam.views()[0]) < len(views) + 60
    assert np.abs(slam.views()[1][:len(views)] - views).max() < 0.05


@pytest.mark.parametrize(('taken', 'put'), [(250, 120), (330, 200), (330, 120)])
def test_a_robot_taken_up_while_it_drives_notices_it_and_is_found(taken: int, put: int) -> None:
    """From one scan to the next it drives elsewhere on its way; its wheels tell nothing of it."""
    stamps, poses = drive.follow(np.array(FIRST), 0.0, 0.6, 400.0)
    taken, put = 10 * taken, 10 * put
    scene, rng = Scene(PLAN.segments), np.random.default_rng(taken + put)
    first = simulate_trial(lambda t: scene, stamps[:taken], poses[:taken], SPARSE, rng)
    second = simulate_trial(lambda t: scene, stamps[:len(poses) - put], poses[put:], SPARSE, rng)
    outcome = run_trial(first.then(second, between(poses[0], poses[put]), SPARSE))
    assert outcome.slam.found and not outcome.slam.lost
    after = np.array([step.stamp for step in outcome.steps]) > outcome.slam.found[0].stamp
    assert np.percentile(np.hypot(*outcome.error[after, :2].T), 95) < METRES


@pytest.mark.parametrize('seed', [1, 3])
def test_people_around_a_robot_do_not_make_it_lost(seed: int) -> None:
    """Four walk beside it for 8 s, half a metre away and more; no scan looks through a wall."""
    rng = np.random.default_rng(seed)
    stamps, poses = drive.follow(np.array(FIRST), 0.0, 0.6, 400.0)
    stamps, poses = stamps[:2500], poses[:2500]
    places = np.column_stack([rng.uniform(0.6, 1.6, 4), rng.uniform(-1.2, 1.2, 4), np.zeros(4)])
    begin = rng.uniform(15.0, 40.0)

    def among_people(stamp: float) -> Scene:
        people = compose(drive.at(stamps, poses, np.array([stamp]))[0], places)
        around = [floor_plan.box(x, y, 0.4, 0.4) for x, y, _ in people]
        if not begin < stamp < begin + 8.0:
            around = []
        return Scene(np.concatenate([PLAN.segments, *around]))

    outcome = run_trial(simulate_trial(among_people, stamps, poses, ROUND, rng))
    assert not outcome.slam.found and not outcome.slam.lost
    assert outcome.distance[-1] < 3.0 * METRES


def test_a_robot_is_tracked_in_a_map_that_stays_as_it_is(mapped: tuple[Checkpoint, Slam]) -> None:
    checkpoint, _ = mapped
    slam = Slam(checkpoint=checkpoint, start=Start(anywhere=True, localization=True))
    before = slam.grid().evidence.copy()
    steps = run(slam, trial(SECOND, -np.pi / 2, 5), IN_MAP)
    assert_found(slam, steps)
    assert np.array_equal(slam.views()[1], checkpoint.poses)
    assert np.array_equal(slam.grid().evidence, before)
    assert slam.driven()[0][0] >= slam.found[0].stamp


def test_a_robot_is_tracked_in_a_drawn_map(mapped: tuple[Checkpoint, Slam]) -> None:
    grid = mapped[1].grid()
    slam = Slam(checkpoint=grid_checkpoint(grid),
                start=Start(anywhere=True, localization=True, drawn=grid))
    steps = run(slam, trial(SECOND, -np.pi / 2, 6), IN_MAP)
    assert_found(slam, steps)
    assert slam.grid() is grid


@pytest.mark.parametrize('resolution, reason', [(1000.0, 'too large'), (1e-6, 'no free space')])
def test_a_map_in_which_no_robot_can_be_found_is_refused(resolution: float, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        grid_checkpoint(Grid(np.ones((50, 50), np.float32), resolution))


def test_a_robot_that_leaves_the_map_and_comes_back_is_never_lost(
        mapped: tuple[Checkpoint, Slam]) -> None:
    grid = mapped[1].grid()
    checkpoint = grid_checkpoint(grid)
    slam = Slam(checkpoint=checkpoint, start=Start(localization=True, anywhere=True, drawn=grid))
    steps = run(slam, trial(OUTSIDE, -np.pi / 2, 8), IN_MAP)
    assert_found(slam, steps, radians=2.0 * RADIANS)       # out there no map holds its heading
    assert not any(step.reason for step, _ in steps if step.stamp > slam.found[0].stamp)
    assert slam.counters['loops_accepted'] > 0             # views of its own hung on the map
    after = slam.checkpoint()
    assert np.array_equal(after.poses, checkpoint.poses)
    assert after.trail[:, 1].max() < len(checkpoint.poses)
    place = compose(checkpoint.poses[after.trail[:, 1].astype(int)], after.trail[:, 2:])
    assert np.abs(place - slam.driven()[1]).max() < 0.001


def test_a_robot_kidnapped_while_it_is_tracked_is_found(mapped: tuple[Checkpoint, Slam]) -> None:
    grid = mapped[1].grid()
    slam = Slam(checkpoint=grid_checkpoint(grid), start=Start(localization=True, anywhere=True,
                                                              drawn=grid))
    first = trial(FIRST[:4], 0.0, 9)
    before = run(slam, first, np.zeros(3))
    assert_found(slam, before)
    steps = run(slam, trial(FIRST[5:], np.pi / 2, 10), between(T_FIRST, (*FIRST[5], np.pi / 2)),
                later=before[-1][0].stamp + 1.0,
                odometry_start=between(first.odometry[0], first.odometry[-1]))
    assert_found(slam, steps, 2)


def test_a_pose_by_hand_ends_the_search(mapped: tuple[Checkpoint, Slam]) -> None:
    slam = Slam(checkpoint=mapped[0], start=Start(anywhere=True, localization=True))
    drawn = trial(SECOND, -np.pi / 2, 7)
    few = replace(drawn, scans=drawn.scans[:4])
    run(slam, few, IN_MAP)
    assert slam.lost
    slam.relocate(IN_MAP + (0.2, -0.1, 0.05), np.diag([0.3, 0.3, 0.1]) ** 2)
    assert not slam.lost
    steps = run(slam, replace(drawn, scans=drawn.scans[4:]), IN_MAP)
    errors = np.array([pose_error(step.pose, truth) for step, truth in steps[5:]])
    assert (np.percentile(errors, 95, axis=0) < (METRES, RADIANS)).all()


def test_parameters_that_change_while_a_robot_is_lost_reach_it(mapped: tuple[Checkpoint, Slam]
                                                               ) -> None:
    """It kept those with which it got lost, until it was found."""
    drawn = trial(SECOND, -np.pi / 2, 11)
    slam = Slam(checkpoint=mapped[0], start=Start(anywhere=True))
    known = slam.counters['views']
    slam.configure(replace(slam.config, minimum_travel_distance=5.0, minimum_travel_heading=3.0))
    run(slam, replace(drawn, scans=drawn.scans[:20]), IN_MAP)
    assert slam.lost
    assert slam.counters['views'] == known + 1


@pytest.mark.parametrize('door', [0, 3])
def test_where_rooms_look_alike_a_robot_waits_rather_than_err(door: int) -> None:
    plan = floor_plan.corridor()
    slam = Slam()
    run(slam, trial([(1.0, 4.5), (25.0, 4.5)], 0.0, 8, plan), np.zeros(3))
    x = 2.2 + 4.3 * door
    again = Slam(checkpoint=slam.checkpoint(), start=Start(anywhere=True, localization=True))
    truth = between(np.array([1.0, 4.5, 0.0]), np.array([x, 4.5, 0.0]))
    steps = run(again, trial([(x, 4.5), (x + 6.0, 4.5)], 0.0, 9 + door, plan), truth)
    for step, true in steps:
        if step.reason != 'lost':
            assert pose_error(step.pose, true)[0] < 0.5


def test_a_robot_that_is_lost_when_its_log_ends_has_driven_what_it_had_before() -> None:
    """Two of a stranger's bags ended so; the trajectory held nothing but the piece."""
    slam, first = Slam(), trial(FIRST[:2], 0.0, 3)
    before = run(slam, first, np.zeros(3))
    assert not ended_lost(slam)
    carried = trial(SECOND, -np.pi / 2, 4)
    after = run(slam, replace(carried, scans=carried.scans[:40]), IN_MAP,
                later=before[-1][0].stamp + 1.0,
                odometry_start=between(first.odometry[0], first.odometry[-1]))
    assert slam.lost
    assert not slam.found
    stamps, poses = slam.driven()
    known = [step for step, _ in before]
    assert stamps[:len(known)].tolist() == [step.stamp for step in known]
    assert pose_error(poses[len(known) - 1], known[-1].pose)[0] < 0.1
    note, = ended_lost(slam)
    assert f'last {after[-1][0].stamp - stamps[-1]:.1f} s' in note


@pytest.mark.parametrize('explained, agreement, rival, believed', [
    (1.0, 1.0, 0.98, False), (0.955, 0.972, 0.85, False), (0.953, 0.960, 0.804, True)],
    ids=['niches', 'equal rooms', 'Wean'])
def test_where_nearly_all_fits_elsewhere_too_a_robot_gone_astray_waits(
        explained: float, agreement: float, rival: float, believed: bool) -> None:
    """The first two were wrong by 4.6 and 5.9 m, the last was right."""
    match = Match(np.zeros(3), 1e6 * np.eye(3), 1.0, 0.01)
    placed = Placed(match, explained, agreement, rival)
    assert (placed.refusal(TUNING.left_astray) == '') is believed


@pytest.mark.parametrize('carried', [(0.8, 0.3, np.pi / 2), (1.1, 0.0, 0.0), (0.0, 0.0, np.pi),
                                     (0.3, 0.0, 0.2), (0.0, 0.0, 0.0)])
def test_a_robot_that_was_moved_a_little_while_it_was_off(
        carried: tuple[float, float, float], mapped: tuple[Checkpoint, Slam]) -> None:
    checkpoint, before = mapped
    slam = Slam(checkpoint=checkpoint)
    stood = compose(T_FIRST, before.trajectory()[1][-1])
    here = compose(stood, np.array(carried))
    way = [tuple(here[:2]), (5.4, 5.2), (5.4, 8.0), (5.4, 5.2), (2.0, 5.2)]
    steps = run(slam, trial(way, float(here[2]), 20), between(T_FIRST, here), later=1000.0,
                odometry_start=np.array(checkpoint.tracker.odometry.pose))
    errors = np.array([pose_error(step.pose, truth) for step, truth in steps
                       if step.reason != 'lost'])
    assert len(errors) > 0.6 * len(steps)
    assert (np.percentile(errors, 95, axis=0) < (METRES, RADIANS)).all()
