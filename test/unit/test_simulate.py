# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated robots keep clear of the walls, see what is there, and do it again by seed."""

import json
from pathlib import Path

from helpers import fake_room, pose_error, ray_cast
import numpy as np
import pytest
from somfusion_ros.cli.main import main
from somfusion_ros.geometry import between, compose, wrap
from somfusion_ros.io.bags.log import BagOptions, open_log
from somfusion_ros.io.errors import InputError
from somfusion_ros.io.trajectories import read_tum
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.raycast import raycast
from somfusion_ros.simulation.simulate import drive_robot, simulate, SimulationOptions
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import Scan

SHORT = SimulationOptions(duration=8.0)


@pytest.fixture(scope='module')
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Simulate two robots for a few seconds."""
    folder = tmp_path_factory.mktemp('simulated')
    simulate(folder, SHORT)
    return folder


def test_raycast_is_the_same_as_ray_by_ray() -> None:
    rng = np.random.default_rng(0)
    walls = fake_room()
    bearings = rng.uniform(-np.pi, np.pi, 300)
    pose = np.array([2.0, 2.0, 0.3])
    ranges, incidence = raycast(walls, np.tile(pose[:2], (300, 1)), pose[2] + bearings)
    assert ranges == pytest.approx(ray_cast(walls, pose, bearings), abs=1e-9)
    assert ((incidence > 0) & (incidence <= 1 + 1e-12)).all()


def test_raycast_of_a_single_wall() -> None:
    wall = np.array([[1.0, -1.0, 1.0, 1.0]])
    angles = np.radians([0.0, 30.0, 60.0, 180.0])
    ranges, incidence = raycast(wall, np.zeros((4, 2)), angles)
    assert ranges == pytest.approx([1.0, 1.0 / np.cos(np.radians(30.0)), np.inf, np.inf])
    assert incidence[:2] == pytest.approx(np.cos(angles[:2]))


@pytest.mark.parametrize('robot', range(5))
@pytest.mark.parametrize('name', sorted(PLANS))
def test_robots_keep_clear_of_the_walls(name: str, robot: int) -> None:
    """A robot of 0.2 m radius never touches anything, and reaches the speed of the issue."""
    plan = PLANS[name]()
    run = drive_robot(plan, robot, SimulationOptions(plan=name), np.random.default_rng(robot))
    start, along = plan.segments[:, :2], plan.segments[:, 2:] - plan.segments[:, :2]
    offset = run.poses[::10, None, :2] - start
    share = np.clip((offset * along).sum(-1) / (along ** 2).sum(-1), 0.0, 1.0)
    assert np.hypot(*np.moveaxis(offset - share[..., None] * along, -1, 0)).min() > 0.2
    speed = np.hypot(*np.diff(run.poses[:, :2], axis=0).T) / drive.STEP
    assert 0.3 < np.quantile(speed, 0.75) <= 0.5 + 1e-6


def test_the_plan_of_the_issue_has_its_size() -> None:
    plan = PLANS['office']()
    corners = plan.segments.reshape(-1, 2)
    assert plan.size == (17.0, 10.0)
    assert (corners.min(0), corners.max(0)) == (pytest.approx([0, 0]), pytest.approx([17, 10]))


def test_the_symmetric_plan_is_symmetric() -> None:
    segments = PLANS['symmetric']().segments
    turned = np.array([17.0, 10.0, 17.0, 10.0]) - segments
    rng = np.random.default_rng(1)
    at, angles = rng.uniform((1, 4.2), (16, 5.7), (200, 2)), rng.uniform(-np.pi, np.pi, 200)
    assert raycast(segments, at, angles)[0] == pytest.approx(raycast(turned, at, angles)[0])


def test_scans_show_the_floor_plan(simulated: Path) -> None:
    """From the true pose, returns lie on walls within the noise, beam by beam."""
    plan = PLANS['office']()
    log = open_log(simulated / 'robot1')
    stamps, truth = read_tum(simulated / 'robot1' / 'reference.tum')
    scans = [record for record in log if isinstance(record, Scan)]
    errors, lost = [], []
    for scan in scans[::7]:
        when = scan.stamp + scan.time_increment * np.arange(len(scan.ranges))
        poses = compose(drive.at(stamps, truth, when), scan.T_base_laser)
        angles = poses[:, 2] + scan.angle_min + scan.angle_increment * np.arange(len(when))
        true = raycast(plan.segments, poses[:, :2], angles)[0]
        returned = (scan.ranges > 0) & np.isfinite(scan.ranges)
        errors.append(np.abs(scan.ranges - true)[returned & (true < 4.3)])
        lost.append((~returned & (true < 4.3)).mean())
    assert len(scans[0].ranges) == 513
    assert scans[0].range_max == 4.5
    assert np.median(np.concatenate(errors)) < 0.025
    assert 0.001 < np.mean(lost) < 0.1
    assert not any(np.isnan(scan.ranges).any() for scan in scans)


def test_odometry_starts_at_zero_and_errs_like_a_real_one(simulated: Path) -> None:
    for robot in ('robot1', 'robot2'):
        odometry = [o for o in open_log(simulated / robot) if isinstance(o, Odometry)]
        stamps, truth = read_tum(simulated / robot / 'reference.tum')
        assert odometry[0].pose == pytest.approx(np.zeros(3))
        true = between(truth[0], drive.at(stamps, truth, np.array([odometry[-1].stamp]))[0])
        distance, angle = pose_error(odometry[-1].pose, true)
        assert 0.0 < distance < 0.6
        assert 0.0 < angle < np.radians(25.0)


def test_odometry_is_what_the_encoders_say(simulated: Path) -> None:
    options = BagOptions(odometry_source='encoders', wheel_radius=drive.NOMINAL.left,
                         wheel_separation=drive.NOMINAL.separation)
    given, integrated = (
        np.array([o.pose for o in open_log(simulated / 'robot1', one) if isinstance(o, Odometry)])
        for one in (BagOptions(), options))
    assert integrated == pytest.approx(given, abs=1e-6)


def test_perfect_wheels_err_by_slip_only(tmp_path: Path) -> None:
    plan, rng = PLANS['office'](), np.random.default_rng(4)
    run = drive_robot(plan, 0, SimulationOptions(wheel_error=0.0), rng)
    turns = np.diff(run.wheels, axis=0)
    turn = drive.NOMINAL.left * (turns[:, 1] - turns[:, 0]).sum() / drive.NOMINAL.separation
    true = wrap(np.diff(run.poses[:, 2])).sum()
    assert turn == pytest.approx(true, abs=0.5)


def test_truth_tells_the_relative_pose_of_the_maps(simulated: Path) -> None:
    truth = json.loads((simulated / 'truth.json').read_text())
    starts = [read_tum(simulated / robot / 'reference.tum')[1][0]
              for robot in ('robot1', 'robot2')]
    pair = truth['pairs'][0]
    assert (pair['target'], pair['source']) == ('robot1', 'robot2')
    found = np.array([pair['transform'][key] for key in ('x', 'y', 'theta')])
    assert found == pytest.approx(between(*starts), abs=1e-5)


def test_same_seed_same_bags(simulated: Path, tmp_path: Path) -> None:
    simulate(tmp_path, SHORT)
    for robot in ('robot1', 'robot2'):
        first, again = (list(open_log(folder / robot)) for folder in (simulated, tmp_path))
        assert len(first) == len(again)
        for a, b in zip(first, again):
            assert a.stamp == b.stamp
            if isinstance(a, Scan):
                assert np.array_equal(a.ranges, b.ranges)
            else:
                assert np.array_equal(a.pose, b.pose)


def test_other_seed_other_start(simulated: Path, tmp_path: Path) -> None:
    simulate(tmp_path, SimulationOptions(robots=1, seed=1, duration=3.0))
    starts = [read_tum(folder / 'robot1' / 'reference.tum')[1][0]
              for folder in (simulated, tmp_path)]
    assert np.abs(starts[0] - starts[1]).max() > 0.01


def test_bags_are_those_of_rosbag2(simulated: Path) -> None:
    metadata = (simulated / 'robot1' / 'bag' / 'metadata.yaml').read_text()
    for word in ('version: 9', 'storage_identifier: mcap', '/tf_static', 'transient_local',
                 'sensor_msgs/msg/LaserScan', 'sensor_msgs/msg/JointState'):
        assert word in metadata


def test_command(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arguments = ['simulate', '--robots', '1', '--duration', '2', '--storage', 'sqlite3',
                 '--plan', 'loop', '--output', str(tmp_path)]
    assert main(arguments) == 0
    assert main(arguments) == 0   # an earlier simulation may be replaced
    said = capsys.readouterr()
    assert 'truth.json' in said.out
    assert said.err == ''
    assert (tmp_path / 'robot1' / 'bag' / 'bag.db3').exists()


def test_nothing_foreign_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / 'robot1').mkdir()
    (tmp_path / 'robot1' / 'thesis.txt').write_text('years of work')
    with pytest.raises(InputError, match='not from an earlier simulation'):
        simulate(tmp_path, SHORT)
    assert (tmp_path / 'robot1' / 'thesis.txt').exists()


def test_a_simulation_that_was_interrupted_can_be_begun_again(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folders passed for somebody else's; begun anew with another seed, the truth was old."""
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt
    truths = []
    for seed in (1, 2):
        options = SimulationOptions(duration=1.5, seed=seed)
        with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
            patched.setattr('somfusion_ros.simulation.simulate.write_bag', interrupt)
            simulate(tmp_path, options)
        truths.append(json.loads((tmp_path / 'truth.json').read_text()))
    assert simulate(tmp_path, options) == truths[1] != truths[0]


def test_no_robot_of_an_earlier_simulation_is_left(tmp_path: Path) -> None:
    (tmp_path / 'robot2').mkdir()
    (tmp_path / 'robot3').mkdir()
    (tmp_path / 'truth.json').write_text('{"transforms": {"robot1": {}, "robot2": {}}}')
    simulate(tmp_path, SimulationOptions(robots=1, duration=2.0))
    assert sorted(path.name for path in tmp_path.iterdir()) == ['robot1', 'robot3', 'truth.json']
