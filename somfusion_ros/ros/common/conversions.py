# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
ROS messages to the core's records and back.

No message goes beyond this file and the nodes. Whatever is wrong with an incoming message raises
ValueError with one line.
"""

from array import array
from collections.abc import Callable, Iterable

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from geometry_msgs.msg import Pose as PoseMessage
from geometry_msgs.msg import (PoseArray, PoseStamped, PoseWithCovarianceStamped, Quaternion,
                               TransformStamped)
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Odometry as OdometryMessage
from nav_msgs.msg import Path
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState, LaserScan, MultiEchoLaserScan, PointCloud2, PointField
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import FREE, Grid, OCCUPIED, UNKNOWN
from somfusion_ros.io import frame_tree
from somfusion_ros.io.cluster_rows import CLUSTER_FIELDS
from somfusion_ros.io.frame_tree import Mount
from somfusion_ros.io.scan_messages import LASERS_APART, scan_from
from somfusion_ros.slam.scan import Scan
from somfusion_ros.team.shared_map import MapCells
from std_msgs.msg import Header

DEFAULT_SIGMA = (0.3, 0.3, 0.2)         # [m, m, rad] where a message has no covariance
LEAST_SIGMA = (0.02, 0.02, 0.01)        # [m, m, rad] added: nothing is known better than this
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))   # x, y, rotation about z in a 6 x 6 covariance


def seconds(stamp: Time) -> float:
    """Return a stamp in seconds."""
    return float(stamp.sec + stamp.nanosec * 1e-9)


def stamp_if_missing(header: Header, now: Time, count: Callable[..., None]) -> None:
    """Stamp a message that has no stamp with the time of its arrival."""
    if header.stamp.sec == 0 and header.stamp.nanosec == 0:
        header.stamp = now
        count('messages_without_stamp', f'{header.frame_id} sends stamps of 0: the time of '
              'arrival is used')


def time_message(stamp: float) -> Time:
    """Convert a stamp [s], to the microsecond that a float resolves today."""
    whole, micro = divmod(round(stamp * 1e6), 1000000)
    return Time(sec=int(whole), nanosec=int(micro) * 1000)


def yaw(q: Quaternion) -> float:
    """Return the heading [rad] of a quaternion; one of all zeros means that nobody set it."""
    values = [q.x, q.y, q.z, q.w]
    if not np.isfinite(values).all():
        raise ValueError(f'orientation is not finite: {values}')
    return frame_tree.yaw(q)


def quaternion(theta: float) -> Quaternion:
    """Return the quaternion of a heading [rad]."""
    return Quaternion(z=float(np.sin(0.5 * theta)), w=float(np.cos(0.5 * theta)))


def pose_from_message(message: PoseMessage) -> Pose:
    """Return the planar part of a pose; ValueError unless finite."""
    return Pose.from_array((message.position.x, message.position.y, yaw(message.orientation)))


def pose_message(pose: Iterable[float]) -> PoseMessage:
    """Return the pose in the plane z = 0."""
    x, y, theta = (float(value) for value in pose)
    return PoseMessage(position=Point(x=x, y=y), orientation=quaternion(theta))


def scan_from_message(message: LaserScan | MultiEchoLaserScan | PointCloud2, mount: Mount,
                      laser: str = '', number: int = 0) -> Scan:
    """
    Convert a scan of a laser, the number of which counts those of the robot, or slice a cloud.

    ValueError where a cloud cannot be read.
    """
    return scan_from(message, mount, seconds(message.header.stamp) + number * LASERS_APART, laser)


def odometry_from_message(message: OdometryMessage) -> tuple[float, Array]:
    """Return stamp [s] and T_odom_base (3,)."""
    return seconds(message.header.stamp), np.array(pose_from_message(message.pose.pose))


def wheels_from_message(message: JointState, left: str, right: str) -> tuple[float, Array]:
    """Return stamp [s] and positions (2,) [rad] of two wheels; ValueError without them."""
    names = list(message.name)
    if left not in names or right not in names:
        raise ValueError(f'joint_states has no {left} and {right}, only {", ".join(names)}')
    if len(message.position) != len(names):
        raise ValueError(f'joint_states has {len(message.position)} positions, {len(names)} names')
    wheels = np.array([message.position[names.index(name)] for name in (left, right)])
    if not np.isfinite(wheels).all():
        raise ValueError('joint_states is not finite')
    return seconds(message.header.stamp), wheels


def cells_from_message(message: OccupancyGrid, max_cells: int) -> MapCells:
    """Return the cells of a map of any origin; ValueError, naming what is wrong, on a bad one."""
    width, height = message.info.width, message.info.height
    if width * height > max_cells:
        raise ValueError(f'grid of {width} x {height} cells is over {max_cells} cells')
    if len(message.data) != width * height:
        raise ValueError(f'grid of {width} x {height} cells has data of {len(message.data)}')
    values = np.frombuffer(message.data, dtype=np.int8).reshape(height, width)
    values = np.where((values >= FREE) & (values <= OCCUPIED), values, np.int8(UNKNOWN))
    resolution = float(str(np.float32(message.info.resolution)))   # 0.05, not 0.05000000074505806
    return MapCells(values, resolution, pose_from_message(message.info.origin))


def grid_from_message(message: OccupancyGrid, max_cells: int) -> Grid:
    """Convert a map of any origin; ValueError, naming what is wrong, on a bad one."""
    cells = cells_from_message(message, max_cells)
    return Grid.from_occupancy(cells.values, cells.resolution, cells.T_frame_grid)


def grid_message(grid: Grid, frame: str, stamp: Time, graded: bool = False) -> OccupancyGrid:
    """
    Convert a map: cells -1, 0 and 100 as Nav2 reads them, or graded evidence 0..100.

    `data` goes in as one block; element by element takes seconds.
    """
    message = OccupancyGrid(header=Header(frame_id=frame, stamp=stamp))
    message.info.map_load_time = stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = (int(side) for side in grid.shape)
    message.info.origin = pose_message(grid.T_frame_grid)
    data = array('b')
    cells = grid.to_occupancy() if graded else grid.to_trinary()
    data.frombytes(cells.tobytes())
    message.data = data
    return message


def pose_with_covariance(pose: Pose, covariance: Array, frame: str,
                         stamp: Time) -> PoseWithCovarianceStamped:
    """Convert a pose and its covariance (3, 3) of x, y, theta."""
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame, stamp=stamp))
    message.pose.pose = pose_message(pose)
    full = np.zeros((6, 6))
    full[PLANAR] = covariance
    message.pose.covariance = full.ravel()
    return message


def planar_covariance(covariance: Iterable[float]) -> Array:
    """Return the covariance (3, 3) of x, y, theta from the 36 numbers of a message."""
    full: Array = np.asarray(covariance, dtype=float).reshape(6, 6)
    planar: Array = full[PLANAR]
    return planar


def usable_covariance(covariance: Iterable[float]) -> Array:
    """Return a covariance (3, 3) that can be inverted; a wide one if the message has none."""
    P: Array = planar_covariance(covariance)
    if not np.isfinite(P).all():
        raise ValueError('covariance is not finite')
    if not np.diag(P).any():
        P = np.diag(DEFAULT_SIGMA) ** 2
    P = (P + P.T) / 2.0 + np.diag(LEAST_SIGMA) ** 2
    if np.linalg.eigvalsh(P)[0] <= 0.0:
        raise ValueError('covariance is not positive')
    return P


def path_message(stamps: Array, poses: Array, frame: str, stamp: Time) -> Path:
    """Return the path through poses (N, 3) at their stamps (N,)."""
    header = Header(frame_id=frame, stamp=stamp)
    return Path(header=header, poses=[
        PoseStamped(header=Header(frame_id=frame, stamp=time_message(float(when))),
                    pose=pose_message(pose))
        for when, pose in zip(stamps, poses, strict=True)])


def pose_array(poses: Iterable[Pose], frame: str, stamp: Time) -> PoseArray:
    """Return several poses in one frame."""
    return PoseArray(header=Header(frame_id=frame, stamp=stamp),
                     poses=[pose_message(pose) for pose in poses])


def transform_message(T_parent_child: Pose, parent: str, child: str,
                      stamp: Time) -> TransformStamped:
    """Transform that takes points of the child frame into the parent frame."""
    message = TransformStamped(header=Header(frame_id=parent, stamp=stamp), child_frame_id=child)
    x, y, theta = T_parent_child
    message.transform.translation.x, message.transform.translation.y = float(x), float(y)
    message.transform.rotation = quaternion(theta)
    return message


def transform_from_message(message: TransformStamped) -> Pose:
    """Return T_parent_child of a transform; ValueError unless finite."""
    t = message.transform
    return Pose.from_array((t.translation.x, t.translation.y, yaw(t.rotation)))


def cluster_cloud(rows: NDArray[np.float32], frame: str, stamp: Time) -> PointCloud2:
    """Return points (K, 7) of CLUSTER_FIELDS as a cloud for RViz and Foxglove."""
    rows = np.ascontiguousarray(rows, dtype=np.float32).reshape(-1, len(CLUSTER_FIELDS))
    cloud = PointCloud2(header=Header(frame_id=frame, stamp=stamp), height=1, width=len(rows),
                        is_dense=True, point_step=4 * len(CLUSTER_FIELDS),
                        row_step=4 * rows.size)
    cloud.fields = [PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
                    for i, name in enumerate(CLUSTER_FIELDS)]
    data = array('B')
    data.frombytes(rows.tobytes())
    cloud.data = data
    return cloud
