# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on real robots, one kind at a time, on simulated drives with truth."""

from dataclasses import replace

import numpy as np
import pytest
from somfusion_ros.geometry import Array, between, compose, Pose, wrap
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box, office, pillar, PLANS, polygon
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import Outcome, run_trial, SICK, simulate_trial, Trial
from somfusion_ros.slam.wheel_odometry import WheelOdometry

pytestmark = pytest.mark.slow
OFFICE = office()
CORRIDOR = OFFICE.route(2)[1:6]          # 11 m along the office's corridor, with both its ends
URG = Laser()
TRUE_WHEELS = drive.Wheels(0.0785, 0.0780, 0.325)   # nominal: 0.077, 0.077, 0.33


def drive_through(walls: Array, route: Array, laser: Laser = SICK, seed: int = 0,
                  speed: float = 0.5, wheels: drive.Wheels = TRUE_WHEELS,
                  slip: float = drive.SLIP) -> Trial:
    """Drive along way points (K, 2) [m] among walls."""
    rng = np.random.default_rng(seed)
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    stamps, poses = drive.follow(np.asarray(route, float), heading, speed, 1000.0)
    return simulate_trial(lambda t: Scene(walls), stamps, poses, laser, rng, wheels, slip)


def with_motion(trial: Trial, extra: Array) -> Trial:
    """Add motions (M, 3) in the base frame to the odometry's steps."""
    steps = between(trial.odometry[:-1], trial.odometry[1:]) + extra[1:]
    poses = [trial.odometry[0]]
    for step in steps:
        poses.append(compose(poses[-1], step))
    return replace(trial, odometry=np.array(poses))


def turning(turns: float, rate: float = 1.0) -> tuple[Array, Array]:
    """Stamps and poses of a robot that drives a little, turns on the spot and drives on."""
    def straight(start: Array) -> Array:
        return compose(start, np.outer(np.arange(0.0, 1.0, 0.01), (1.0, 0.0, 0.0)))
    angle = np.arange(0.0, 2.0 * np.pi * turns, rate * drive.STEP)
    before = straight(np.array([1.2, 7.5, -0.2]))
    spin = compose(before[-1], np.outer(angle, (0.0, 0.0, 1.0)))
    poses = np.concatenate([before, spin, straight(spin[-1])])
    return drive.STEP * np.arange(len(poses)), poses


def ring(length: float, width: float) -> tuple[Array, Array]:
    """Walls and route of a corridor around a block, with cupboards at uneven places."""
    rng = np.random.default_rng(5)
    w = 1.2
    parts = [polygon([(-w, -w), (length + w, -w), (length + w, width + w), (-w, width + w)]),
             polygon([(w, w), (length - w, w), (length - w, width - w), (w, width - w)])]
    for x in np.cumsum(rng.uniform(2.0, 5.0, 9)):
        parts += [box(x, -w + 0.15, rng.uniform(0.3, 1.2), 0.3),
                  box(x + rng.uniform(-1, 1), width + w - 0.15, rng.uniform(0.3, 1.2), 0.3)]
    for y in np.cumsum(rng.uniform(2.0, 4.0, 3)):
        parts += [pillar(length + w - 0.2, y, 0.2), box(-w + 0.1, y, 0.2, rng.uniform(0.4, 1.0))]
    corners = np.array([(0, 0), (length, 0), (length, width), (0, width)], float)
    return np.concatenate(parts), np.concatenate([corners, [(0, 0), (4, 0)]])


def assert_followed(out: Outcome, distance: float, angle: float = 0.05) -> None:
    """Expect the final trajectory within a distance [m] and an angle [rad] of the truth."""
    assert out.distance.max() < distance
    assert np.abs(out.corrected[:, 2]).max() < angle


@pytest.mark.parametrize('caught_up', [False, True])
def test_odometry_that_stalls(caught_up: bool) -> None:
    """
    For 1.2 s the odometry stands; what it missed never comes, or comes all at once.

    Where the walls fix nothing along them, one scan, 0.1 m farther on, may believe it.
    """
    trial = drive_through(OFFICE.segments, CORRIDOR)
    steps = between(trial.odometry[:-1], trial.odometry[1:])
    silent = (trial.odometry_stamps > 8.0) & (trial.odometry_stamps <= 9.2)
    missing = np.zeros((len(silent), 3))
    missing[silent] = -steps[silent[1:]]
    if caught_up:
        missing[np.flatnonzero(silent)[-1] + 1] = steps[silent[1:]].sum(0)
    assert np.hypot(*missing[silent].sum(0)[:2]) > 0.4, 'the odometry misses a piece of the way'
    assert_followed(run_trial(with_motion(trial, missing)), 0.14)


def test_odometry_that_jumps() -> None:
    trial = drive_through(OFFICE.segments, CORRIDOR)
    after = trial.odometry_stamps > 9.0
    jumped = np.where(after[:, None], compose((6.0, -4.0, 2.0), trial.odometry), trial.odometry)
    out = run_trial(replace(trial, odometry=jumped))
    assert out.slam.counters['odometry_jumps'] >= 1
    assert_followed(out, 0.12)


@pytest.mark.parametrize('wheels', [(1.0, 1.0), (1.0, 0.0)])
def test_wheels_that_slip(wheels: tuple[float, float]) -> None:
    """On a wet spot the wheels, or one, turn by half a metre more than the robot moves."""
    trial = drive_through(OFFICE.segments, CORRIDOR)
    slipping = (trial.odometry_stamps > 8.0) & (trial.odometry_stamps <= 9.5)
    more = np.cumsum(slipping)[:, None] / slipping.sum() * (0.5 / drive.NOMINAL.left)
    reckoning = WheelOdometry(drive.NOMINAL.left, drive.NOMINAL.separation)
    slipped = np.array([reckoning.update(*w) for w in trial.wheels + more * wheels])
    assert_followed(run_trial(replace(trial, odometry=slipped)), 0.12)


@pytest.mark.parametrize('laser', [SICK, URG])
def test_spinning_in_place(laser: Laser) -> None:
    stamps, poses = turning(3.0)
    trial = simulate_trial(lambda t: Scene(OFFICE.segments), stamps, poses, laser,
                           np.random.default_rng(1), TRUE_WHEELS)
    assert_followed(run_trial(trial), 0.12)


def test_a_corridor_without_features_leaves_the_way_along_it_uncertain() -> None:
    """30 m between bare walls: the error along them stays within the published 3 sigma."""
    walls = polygon([(-20, -1), (60, -1), (60, 1), (-20, 1)])
    wheels = drive.Wheels(0.0793, 0.0793, 0.33)      # 3 % larger than the odometry believes
    out = run_trial(drive_through(walls, np.array([(0.0, 0.1), (30.0, -0.1)]), URG, wheels=wheels))
    sigma = np.sqrt(np.diagonal(out.covariance, axis1=1, axis2=2))[20:]
    assert (np.abs(out.error[20:, 0]) < 3.0 * sigma[:, 0]).all()
    assert (np.abs(out.error[20:, 1]) < 3.0 * sigma[:, 1] + 0.02).all()
    assert sigma[-1, 0] > 0.3, 'nothing along the corridor tells how far the robot went'
    assert np.abs(out.error[:, 2]).max() < 0.02


def test_a_symmetric_building_is_not_folded() -> None:
    """Both halves are alike; a loop between them would turn the map over."""
    plan = PLANS['symmetric']()
    route = plan.route(0)
    out = run_trial(drive_through(plan.segments, route, slip=0.03))
    assert out.slam.counters['views'] > 60
    assert_followed(out, 0.25)


def test_people_walking() -> None:
    """Five people pace the corridor at 1.2 m/s, beside the robot and in its way."""
    rng = np.random.default_rng(3)
    start, reach = rng.uniform((2, 4.8), (16, 5.7), (5, 2)), rng.uniform(2.0, 4.0, 5)
    stamps, poses = drive.follow(CORRIDOR, 1.6, 0.5, 1000.0)
    hidden = []

    def scenery(t: float) -> Scene:
        robot = drive.at(stamps, poses, np.array([t]))[0, :2]
        at = start + np.outer(reach * np.sin(1.2 * t / reach + np.arange(5)), (1.0, 0.0))
        at = at[(np.hypot(*(at - robot).T) > 0.7) & (at[:, 0] > 0.3) & (at[:, 0] < 16.7)]
        hidden.append((0.4 / np.hypot(*(at - robot).T)).sum() / np.pi)
        return Scene(np.concatenate([OFFICE.segments, *(pillar(x, y, 0.2) for x, y in at)]))
    out = run_trial(simulate_trial(scenery, stamps, poses, SICK, rng, TRUE_WHEELS))
    assert max(hidden) > 0.2, 'people hide a fifth of what the laser sees, at times'
    assert_followed(out, 0.12)


def test_glass_and_mirrors() -> None:
    """A third of the corridor's wall is glass, and two mirrors show rooms that are not there."""
    walls = OFFICE.segments
    middle = 0.25 * (walls[:, ::2] + walls[:, 1::2]).sum(1)
    glass = (np.abs(middle - 5.9) < 0.2) | ((walls[:, 1] == 4.46) & (walls[:, 0] > 8.0))
    mirrors = np.array([(6.0, 4.47, 7.0, 4.47), (12.0, 4.47, 12.6, 4.47), (0.02, 4.6, 0.02, 5.8)])
    stamps, poses = drive.follow(CORRIDOR, 1.6, 0.5, 1000.0)
    trial = simulate_trial(lambda t: Scene(walls[~glass], walls[glass], mirrors), stamps, poses,
                           SICK, np.random.default_rng(4), TRUE_WHEELS)
    assert_followed(run_trial(trial), 0.12)


def test_gaps_between_scans() -> None:
    """Three times no scan comes for 2.5 s, while the robot drives and turns."""
    trial = drive_through(OFFICE.segments, OFFICE.route(2)[:7])
    gaps = [(6.0, 8.5), (14.0, 16.5), (24.0, 26.5)]
    scans = [s for s in trial.scans if not any(a < s.stamp < b for a, b in gaps)]
    assert len(scans) < len(trial.scans) - 30
    assert_followed(run_trial(replace(trial, scans=scans)), 0.12)


@pytest.mark.parametrize('offset', [-0.05, 0.05])
def test_clocks_of_laser_and_odometry_50_ms_apart(offset: float) -> None:
    trial = drive_through(OFFICE.segments, OFFICE.route(0)[:9])
    out = run_trial(replace(trial, odometry_stamps=trial.odometry_stamps + offset))
    assert out.slam.odometry_lag == pytest.approx(offset, abs=0.03)
    assert_followed(out, 0.12)


def test_scans_are_deskewed_by_their_time_increment() -> None:
    """Turning at 1 rad/s, a mirror of 0.1 s bends a scan by 4 degrees; without it, it shows."""
    stamps, poses = turning(2.0)
    trial = simulate_trial(lambda t: Scene(OFFICE.segments), stamps, poses, URG,
                           np.random.default_rng(1), slip=0.002)
    skewed = replace(trial, scans=[replace(s, time_increment=0.0) for s in trial.scans])
    straight, bent = (np.abs(run_trial(t).error[:, 2]) for t in (trial, skewed))
    assert straight.max() < 0.03, 'largest where the turn begins, amid a sweep'
    assert np.median(straight) < 0.5 * np.median(bent)


def test_a_laser_turned_by_90_degrees() -> None:
    laser = replace(SICK, mount=Pose(0.1, 0.05, float(np.pi / 2)))
    assert_followed(run_trial(drive_through(OFFICE.segments, CORRIDOR, laser)), 0.12)


def test_a_laser_of_180_beams_and_4_metres() -> None:
    laser = replace(URG, beams=180, range_max=4.0)
    assert_followed(run_trial(drive_through(OFFICE.segments, OFFICE.route(2)[:7], laser)), 0.25)


def test_scans_every_metre() -> None:
    laser = replace(SICK, period=2.0)
    trial = drive_through(OFFICE.segments, OFFICE.route(2)[:7], laser)
    places = trial.truth(np.array([s.stamp for s in trial.scans]))
    travel = np.hypot(*np.diff(places[:, :2], axis=0).T)
    assert np.median(travel) > 0.9
    assert_followed(run_trial(trial), 0.15)


def test_very_noisy_odometry() -> None:
    """Each wheel errs by 8 cm after a metre; dead reckoning is lost within metres."""
    trial = drive_through(OFFICE.segments, OFFICE.route(2)[:7], slip=0.08)
    blind = wrap(trial.odometry[-1] - trial.truth(trial.odometry_stamps[-1:])[0])
    out = run_trial(trial)
    assert_followed(out, 0.15)
    assert np.hypot(*blind[:2]) > 5.0 * out.distance[-1]


def test_a_loop_of_100_metres() -> None:
    walls, route = ring(34.0, 16.0)
    laser = replace(SICK, range_max=8.0, period=0.4)
    out = run_trial(drive_through(walls, route, laser, speed=1.0))
    assert out.slam.counters['loops_accepted'] >= 3
    e = out.error[-1]
    assert np.hypot(*e[:2]) < 0.3, 'back at the start, where the loop was closed'
    assert_followed(out, 0.8, 0.06)
