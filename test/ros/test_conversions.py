# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages to records and back: nothing is lost, and what is wrong is named."""

from array import array

from helpers import cut_grid, fake_grid, fake_room, fake_scan, furnished_room, need_ros, pose_error
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.alignment import align
from somfusion_ros.geometry import inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.team.global_map import merge_grids

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from geometry_msgs.msg import Quaternion  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from sensor_msgs.msg import JointState, LaserScan  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402

LIMIT = 10 ** 6
angles = st.floats(-3.14, 3.14)
metres = st.floats(-1e4, 1e4)


def over_the_wire(message: object) -> object:
    """Send a message through its serialisation, as DDS does."""
    return deserialize_message(serialize_message(message), type(message))


def grid_message(**changes: object) -> OccupancyGrid:
    """Make a good message of 3 x 2 cells, then spoil it."""
    message = OccupancyGrid()
    message.info.resolution, message.info.width, message.info.height = 0.1, 3, 2
    message.data = array('b', [-1, 0, 100, 50, 20, -1])
    for name, value in changes.items():
        owner, _, last = name.rpartition('__')
        target = message
        for part in filter(None, owner.split('__')):
            target = getattr(target, part)
        setattr(target, last, value)
    return message


@given(angles)
def test_yaw_and_quaternion_undo_each_other(theta: float) -> None:
    assert convert.yaw(convert.quaternion(theta)) == pytest.approx(theta, abs=1e-9)


def test_a_quaternion_that_nobody_set_is_no_turn() -> None:
    assert convert.yaw(Quaternion(w=0.0)) == 0.0


@pytest.mark.parametrize('part', 'xyzw')
def test_a_quaternion_with_nan_is_refused(part: str) -> None:
    with pytest.raises(ValueError, match='orientation'):
        convert.yaw(Quaternion(**{part: float('nan')}))


@given(st.floats(0, 2e9))
def test_stamps_keep_microseconds(stamp: float) -> None:
    assert convert.seconds(convert.time_message(stamp)) == pytest.approx(stamp, abs=1e-6)


@settings(max_examples=30, deadline=None)
@given(metres, metres, angles)
def test_poses_and_transforms_come_back(x: float, y: float, theta: float) -> None:
    pose = Pose(x, y, theta)
    assert np.allclose(convert.pose_from_message(over_the_wire(convert.pose_message(pose))), pose)
    transform = convert.transform_message(pose, 'map', 'robot2/map', Time(sec=3))
    assert np.allclose(convert.transform_from_message(over_the_wire(transform)), pose)
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'robot2/map')


@pytest.mark.parametrize('yaw', [0.0, 0.7, -3.0])
def test_a_map_comes_back_cell_by_cell(yaw: float) -> None:
    grid = fake_grid(fake_room(), T_map_walls=Pose(2.0, -3.0, yaw))
    message = over_the_wire(convert.grid_message(grid, 'map', Time(sec=5)))
    again = convert.grid_from_message(message, LIMIT)
    assert message.header.frame_id == 'map'
    assert message.header.stamp.sec == message.info.map_load_time.sec == 5
    assert np.array_equal(again.to_occupancy(), grid.to_occupancy())
    assert np.allclose(again.T_frame_grid, grid.T_frame_grid)
    assert again.resolution == grid.resolution


def test_a_large_map_is_filled_fast() -> None:
    from time import perf_counter
    grid = Grid(np.zeros((2000, 2000), np.float32), 0.05)
    start = perf_counter()
    message = convert.grid_message(grid, 'map', Time())
    assert isinstance(message.data, array)
    assert perf_counter() - start < 0.5   # element by element takes well over a second


@pytest.mark.parametrize(('changes', 'words'), [
    ({'info__width': 0}, 'data of 6'),
    ({'info__width': 0, 'info__height': 0, 'data': array('b')}, 'at least one cell'),
    ({'data': array('b', [0] * 5)}, 'data of 5'),
    ({'data': array('b')}, 'data of 0'),
    ({'info__resolution': 0.0}, 'resolution'),
    ({'info__resolution': -0.05}, 'resolution'),
    ({'info__resolution': float('nan')}, 'resolution'),
    ({'info__resolution': float('inf')}, 'resolution'),
    ({'info__origin__position__x': float('nan')}, 'finite'),
    ({'info__origin__position__y': float('inf')}, 'finite'),
    ({'info__origin__orientation__z': float('nan')}, 'orientation'),
    ({'info__width': 4000000000, 'info__height': 4000000000}, 'over'),
    ({'info__width': 1001, 'info__height': 1000}, 'over 1000000 cells')])
def test_bad_maps_are_named(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        convert.grid_from_message(over_the_wire(grid_message(**changes)), LIMIT)


def test_values_that_are_no_percentage_are_unknown() -> None:
    grid = convert.grid_from_message(grid_message(data=array('b', [-128, 101, 127, 0, 0, 0])),
                                     LIMIT)
    assert not grid.known[0].any()
    assert grid.free[1].all()


def test_a_scan_comes_over_as_it_is() -> None:
    scan = fake_scan(fake_room(), (2.0, 2.0, 0.3), stamp=12.5)
    message = LaserScan(angle_min=scan.angle_min, angle_increment=scan.angle_increment,
                        range_min=scan.range_min, range_max=scan.range_max,
                        ranges=array('f', scan.ranges))
    message.header.stamp = convert.time_message(scan.stamp)
    mount = Pose(0.1, 0.0, 0.2)
    again = convert.scan_from_message(over_the_wire(message), Mount(mount))
    assert again.stamp == 12.5
    assert np.array_equal(again.ranges, scan.ranges.astype(np.float32))
    assert again.angle_increment == pytest.approx(scan.angle_increment)
    assert again.T_base_laser == mount


def test_a_laser_upside_down_turns_the_other_way() -> None:
    message = LaserScan(angle_min=-1.0, angle_increment=0.5, ranges=[1.0] * 3)
    scan = convert.scan_from_message(message, Mount(Pose(), upside_down=True))
    assert (scan.angle_min, scan.angle_increment) == (1.0, -0.5)


@pytest.mark.parametrize('ranges', [[], [float('nan')] * 4, [float('inf')] * 4])
def test_scans_without_a_return_are_left_to_slam(ranges: list[float]) -> None:
    scan = convert.scan_from_message(LaserScan(ranges=ranges), Mount(Pose()))
    assert len(scan.ranges) == len(ranges)


def test_odometry_is_planar_and_finite() -> None:
    message = Odometry()
    message.header.stamp = Time(sec=7, nanosec=500000000)
    message.pose.pose = convert.pose_message((1.0, 2.0, 0.5))
    stamp, pose = convert.odometry_from_message(message)
    assert stamp == 7.5
    assert np.allclose(pose, (1.0, 2.0, 0.5))
    message.pose.pose.position.x = float('nan')
    with pytest.raises(ValueError, match='finite'):
        convert.odometry_from_message(message)


def test_wheels_are_found_by_name() -> None:
    message = JointState(name=['arm', 'r', 'l'], position=[9.0, 2.0, 1.0])
    assert convert.wheels_from_message(message, 'l', 'r')[1].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(('names', 'positions', 'words'), [
    (['l'], [1.0], 'no l and r'), (['l', 'r'], [1.0], '1 positions'),
    (['l', 'r'], [1.0, float('nan')], 'not finite'), ([], [], 'no l and r')])
def test_joints_without_usable_wheels_are_named(names: list[str], positions: list[float],
                                                words: str) -> None:
    with pytest.raises(ValueError, match=words):
        convert.wheels_from_message(JointState(name=names, position=positions), 'l', 'r')


def test_a_covariance_goes_to_x_y_and_yaw() -> None:
    covariance = np.arange(9.0).reshape(3, 3)
    message = over_the_wire(convert.pose_with_covariance(Pose(), covariance, 'map', Time()))
    full = np.asarray(message.pose.covariance).reshape(6, 6)
    assert (full[0, 0], full[0, 5], full[5, 1], full[5, 5]) == (0.0, 2.0, 7.0, 8.0)
    assert full[2:5].sum() == full[:, 2:5].sum() == 0.0
    assert np.array_equal(convert.planar_covariance(message.pose.covariance), covariance)


def test_a_path_has_every_view_at_its_stamp() -> None:
    path = convert.path_message(np.array([1.0, 2.5]), np.array([[0, 0, 0], [1, 2, 0.5]]), 'map',
                                Time(sec=9))
    assert [convert.seconds(p.header.stamp) for p in path.poses] == [1.0, 2.5]
    assert np.allclose(convert.pose_from_message(path.poses[1].pose), (1, 2, 0.5))


def test_a_cluster_cloud_is_read_back_by_its_fields() -> None:
    rows = np.arange(14, dtype=np.float32).reshape(2, 7)
    cloud = over_the_wire(convert.cluster_cloud(rows, 'map', Time()))
    kind = np.dtype([(f.name, '<f4') for f in sorted(cloud.fields, key=lambda f: f.offset)])
    points = np.frombuffer(cloud.data, dtype=kind)
    assert kind.names == convert.CLUSTER_FIELDS
    assert kind.itemsize == cloud.point_step
    assert points['weight'].tolist() == [6.0, 13.0]
    assert convert.cluster_cloud(np.zeros((0, 7), np.float32), 'map', Time()).width == 0


def as_slam_toolbox_does(grid: Grid) -> OccupancyGrid:
    """Publish a map as slam_toolbox does: -1, 0 and 100 only, no yaw, no larger than known."""
    level = merge_grids({'own': grid}, {'own': Pose()})
    message = convert.grid_message(level, 'map', Time(sec=5))
    cells = np.where(level.occupied, 100, np.where(level.free, 0, -1)).astype(np.int8)
    message.data = array('b', cells.tobytes())
    return over_the_wire(message)


@pytest.mark.parametrize('share', [0.8, 1.0], ids=['still growing', 'whole'])
def test_grids_in_the_format_of_slam_toolbox_merge(share: float) -> None:
    walls, T_map_walls = furnished_room(), Pose(3.0, -2.0, 0.6)
    seen = cut_grid(fake_grid(walls), (-1.0, -1.0), (14.0 * share, 12.0))
    target, source = (convert.grid_from_message(as_slam_toolbox_does(grid), LIMIT)
                      for grid in (seen, fake_grid(walls, T_map_walls=T_map_walls)))
    found = align(target, source, rng=np.random.default_rng(0))
    assert found.accepted, found.reason
    metres, radians = pose_error(found.T_target_source, inverse(T_map_walls))
    assert metres < 0.05
    assert radians < np.radians(0.5)
