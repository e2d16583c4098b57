# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The whole of one robot's SLAM on simulated drives with truth."""

from collections import Counter
from dataclasses import replace
from threading import Thread

from helpers import fake_odometry, fake_room, fake_scan, fake_trajectory, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.lost import Lost
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.scan import cloud
from somfusion_ros.slam.single_map import SingleMap
from somfusion_ros.slam.slam import Slam

ROOM = fake_room(10.0, 7.0)
LOOP = np.array([(1, 1), (5.5, 1), (9, 1.2), (9, 3), (6.5, 3.2), (3, 3.3), (1.2, 5.5), (1, 1.2),
                 (4, 1.0)])


def drive(noise=(0.03, 0.03), lag=0.0, seed=0, waypoints=LOOP, **scan):
    """Make scans, the buffer of odometry, and true poses in the frame of the first."""
    rng = np.random.default_rng(seed)
    stamps, poses = fake_trajectory(waypoints, rate=5.0)
    odometry = fake_odometry(poses, noise, rng)
    scans = [fake_scan(ROOM, p, t, noise=0.01, rng=rng, **scan)
             for t, p in zip(stamps, poses, strict=True)]
    buffer = OdometryBuffer()
    for t, pose in zip(stamps, odometry, strict=True):
        buffer.add(t + lag, pose)
    return scans, buffer, between(poses[0], poses)


def run(scans, buffer, slam=None):
    slam = slam or Slam()
    steps = []
    for scan in scans:
        buffer.lag = slam.odometry_lag
        odometry = buffer.at(scan.stamp)
        if odometry is not None:
            steps.append(slam.process(scan, odometry))
    return slam, steps


def errors(slam, scans, truth):
    stamps, poses = slam.trajectory()
    at = np.searchsorted([s.stamp for s in scans], stamps)
    d = between(between(truth[at[0]], truth[at]), poses)
    return np.hypot(d[:, 0], d[:, 1]), np.abs(d[:, 2])


def test_a_drive_round_a_room_is_followed():
    scans, buffer, truth = drive()
    slam, steps = run(scans, buffer)
    distance, angle = errors(slam, scans, truth)
    assert distance.max() < 0.08 and angle.max() < np.radians(1.5)
    assert all(s.matched for s in steps[1:])
    assert slam.counters['loops_accepted'] > 0


@pytest.mark.slow
def test_dead_reckoning_is_much_worse_than_the_slam():
    scans, buffer, truth = drive(noise=(0.06, 0.06))
    slam, _ = run(scans, buffer)
    distance, _ = errors(slam, scans, truth)
    buffer.lag = 0.0
    blind = [between(truth[k], buffer.at(s.stamp).pose) for k, s in enumerate(scans)]
    assert distance.mean() < 0.2 * np.hypot(*np.array(blind)[:, :2].T).mean()


@pytest.mark.slow
def test_the_same_input_gives_the_same_result_bit_for_bit():
    scans, buffer, _ = drive()
    results = [run(scans, buffer)[0] for _ in range(2)]
    a, b = (s.trajectory()[1] for s in results)
    np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(results[0].grid().evidence, results[1].grid().evidence)


@pytest.mark.slow
def test_a_lag_of_the_clocks_is_learned():
    scans, buffer, _ = drive(lag=0.15, noise=(0.01, 0.01))
    slam, _ = run(scans, buffer)
    assert slam.odometry_lag == pytest.approx(0.15, abs=0.03)


@pytest.mark.slow
def test_a_turn_scale_is_learned():
    scans, buffer, truth = drive(noise=(0.0, 0.0))
    wrong = OdometryBuffer()
    pose = np.zeros(3)
    for k, scan in enumerate(scans):
        if k:
            pose = compose(pose, between(truth[k - 1], truth[k]) * (1.0, 1.0, 1 / 1.05))
        wrong.add(scan.stamp, pose)
    slam, _ = run(scans, wrong)
    distance, _ = errors(slam, scans, truth)
    assert slam._map.tracker.calibration.turning[1] == pytest.approx(0.05, abs=0.02)
    assert distance.max() < 0.08


@pytest.mark.slow
def test_an_odometry_that_stalls_is_overruled():
    scans, buffer, truth = drive(noise=(0.01, 0.01))
    stalled, offset, frozen = OdometryBuffer(), np.zeros(3), None
    for k, scan in enumerate(scans):
        pose = buffer.at(scan.stamp).pose
        if 60 <= k < 63:
            frozen = frozen if frozen is not None else pose
            stalled.add(scan.stamp, frozen)
        else:
            if k == 63:
                offset = compose(frozen, between(pose, np.zeros(3)))
            stalled.add(scan.stamp, compose(offset, pose) if k >= 63 else pose)
    slam, _ = run(scans, stalled)
    distance, _ = errors(slam, scans, truth)
    assert distance[-20:].max() < 0.12


@pytest.mark.slow
def test_an_odometry_that_jumps_is_counted_and_overruled():
    scans, buffer, truth = drive(noise=(0.01, 0.01))
    jumped = OdometryBuffer()
    for k, scan in enumerate(scans):
        pose = buffer.at(scan.stamp).pose
        jumped.add(scan.stamp, compose((8.0, -3.0, 1.0), pose) if k > 70 else pose)
    slam, _ = run(scans, jumped)
    distance, _ = errors(slam, scans, truth)
    assert slam.counters['odometry_jumps'] == 1
    assert distance.max() < 0.12


@pytest.mark.slow
def test_a_jump_of_kilometres_across_a_pause_of_hours_keeps_the_map():
    """Bound: 0.12 m, as if there had been neither; the map stays as small as the room."""
    scans, buffer, truth = drive(noise=(0.01, 0.01))
    jumped = OdometryBuffer()
    for k, scan in enumerate(scans):
        pose, late = buffer.at(scan.stamp).pose, k > 70
        scans[k] = replace(scan, stamp=scan.stamp + 36000.0 * late)
        jumped.add(scans[k].stamp, compose((8e4, -3e4, 1.0), pose) if late else pose)
    slam, _ = run(scans, jumped)
    distance, _ = errors(slam, scans, truth)
    assert slam.counters['odometry_jumps'] == 1
    assert distance.max() < 0.12
    assert max(slam.grid().shape) < 400


@pytest.mark.slow
@pytest.mark.parametrize('spoil, reason', [
    (lambda s: replace(s, ranges=np.full(513, np.nan)), 'too few'),
    (lambda s: replace(s, ranges=np.zeros(513)), 'too few'),
    (lambda s: replace(s, ranges=np.full(513, np.inf)), 'too few'),
    (lambda s: replace(s, ranges=np.zeros(0)), 'scan_empty'),
    (lambda s: replace(s, stamp=s.stamp - 3.0), 'scan_stamps_backward'),
    (lambda s: replace(s, stamp=np.nan), 'scan_not_finite'),
    (lambda s: replace(s, angle_increment=0.0), 'scan_geometry_invalid'),
    (lambda s: replace(s, ranges=s.ranges[::2], angle_increment=2 * s.angle_increment), ''),
])
def test_bad_scans_among_good_ones_change_nothing(spoil, reason):
    scans, buffer, truth = drive(noise=(0.01, 0.01))
    mixed = [spoil(s) if k % 7 == 3 else s for k, s in enumerate(scans)]
    slam = Slam()
    for scan, clean in zip(mixed, scans, strict=True):
        slam.process(scan, buffer.at(clean.stamp))
    good = [k for k in range(len(scans)) if k % 7 != 3]
    stamps, poses = slam.trajectory()
    at = np.isin(stamps, [scans[k].stamp for k in good])
    d = between(truth[good], poses[at])
    assert np.hypot(*d[:, :2].T).max() < 0.1
    if reason.startswith('scan_'):
        assert slam.counters[reason] == sum(k % 7 == 3 for k in range(len(scans)))


def test_a_repeated_scan_is_counted_once():
    scans, buffer, _ = drive()
    slam = Slam()
    for scan in scans[:20]:
        slam.process(scan, buffer.at(scan.stamp))
        again = slam.process(scan, buffer.at(scan.stamp))
        assert not again.accepted and again.reason == 'scan_stamps_repeated'
    assert len(slam.trajectory()[0]) == 20


@pytest.mark.parametrize('part', ['pose', 'twist'])
def test_odometry_that_is_not_a_number_changes_nothing(part):
    scans, buffer, truth = drive(noise=(0.01, 0.01), waypoints=LOOP[:3])
    slam, missing = Slam(), np.full(3, np.nan)
    for k, scan in enumerate(scans):
        odometry = buffer.at(scan.stamp)
        step = slam.process(scan, replace(odometry, **{part: missing}) if k % 5 == 2 else odometry)
        assert step.accepted == (k % 5 != 2)
    assert slam.counters['odometry_not_finite'] == sum(k % 5 == 2 for k in range(len(scans)))
    assert errors(slam, scans, truth)[0].max() < 0.1


def test_nothing_seen_yet_is_an_empty_map():
    slam = Slam()
    assert slam.grid().shape == (1, 1)
    assert len(slam.views()[0]) == len(slam.trajectory()[0]) == 0
    assert slam.pose_sigma == (0.0, 0.0, 0.0) and not slam.work()


@pytest.mark.slow
def test_loops_can_be_closed_by_another_thread():
    scans, buffer, truth = drive()
    slam, running = Slam(background=True), True

    def work():
        while running or slam.work():
            slam.work()
            slam.grid()
    thread = Thread(target=work)
    thread.start()
    run(scans, buffer, slam)
    running = False
    thread.join(30.0)
    assert not thread.is_alive()
    distance, _ = errors(slam, scans, truth)
    assert distance.max() < 0.1 and slam.counters['loops_accepted'] > 0


@pytest.mark.slow
@pytest.mark.parametrize('setup', [
    {'beams': 181, 'field_of_view': np.pi, 'range_max': 30.0},
    {'beams': 720, 'field_of_view': 2 * np.pi * 719 / 720, 'range_max': 12.0},
    {'beams': 241, 'field_of_view': np.radians(240.0), 'range_max': 4.0},
])
def test_any_laser_will_do(setup):
    scans, buffer, truth = drive(**setup)
    slam, _ = run(scans, buffer)
    distance, _ = errors(slam, scans, truth)
    assert distance.max() < 0.12


@pytest.mark.slow
def test_views_are_kept_by_travel():
    scans, buffer, _ = drive()
    few, many = (run(scans, buffer, Slam(SlamConfig(minimum_travel_distance=d)))[0]
                 for d in (1.0, 0.2))
    assert len(few.views()[0]) < len(many.views()[0])


@pytest.mark.slow
def test_the_covariance_covers_the_error():
    nees = []
    for seed in range(6):
        scans, buffer, truth = drive(seed=seed, waypoints=LOOP[:6])
        slam, steps = run(scans, buffer)
        last = steps[-1]
        e = between(truth[-1], np.array(last.pose))
        nees.append(e @ np.linalg.solve(last.covariance, e))
    assert np.mean(nees) < 8.0, 'mean NEES of 3 degrees of freedom, 6 runs'
    assert pose_error(np.array(last.pose), truth[-1])[0] < 0.1


class FoundMeanwhile(Slam):
    """A lost robot that another thread finds as soon as one has looked whether it is lost."""

    @property
    def _lost(self) -> Lost | None:
        self._left -= 1
        return Lost(self.config, self.counters, lambda: None) if self._left >= 0 else None

    @_lost.setter
    def _lost(self, lost: Lost | None) -> None:
        self._left = 1


@pytest.mark.parametrize('ask', [lambda slam: slam.lost, lambda slam: slam.odometry_lag,
                                 lambda slam: slam.driven()])
def test_a_robot_may_be_found_by_another_thread_at_any_moment(ask) -> None:
    ask(FoundMeanwhile())


def test_a_piece_of_map_that_is_joined_goes_on_with_the_newest_parameters():
    scans, buffer, _ = drive()
    maps = [SingleMap(SlamConfig(), Counter()) for _ in range(2)]
    for scan in scans[:30]:
        for single in maps:
            single.follow(scan.stamp, cloud(scan, 30.0), buffer.at(scan.stamp))
    config = SlamConfig(minimum_inlier_ratio=0.5, loop_minimum_gap=30)
    maps[0].configure(config)
    maps[0].absorb(maps[1], 0, np.zeros(3), np.eye(3))
    assert maps[0].tracker.config is config
    assert maps[0]._fresh.maxlen == 30
