# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a replay found, over time, as a bag for Foxglove and RViz: one tree, prefixed frames."""

from collections.abc import Iterable, Mapping
from pathlib import Path
import shutil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.bags.writer import BagWriter, quaternion
from somfusion_ros.io.cluster_rows import CLUSTER_FIELDS, cluster_rows
from somfusion_ros.io.console import progress_bar
from somfusion_ros.io.errors import InputError
from somfusion_ros.offline.history import History
from somfusion_ros.offline.robot_run import RobotRun
from somfusion_ros.slam.step import Step
from somfusion_ros.team.offline import fuse, Fusion
import yaml

if TYPE_CHECKING:
    from typing_extensions import Self

MAPS = 30             # of each robot, in the time of the longest log
SHORTEST_PERIOD = 2.0   # [s]
FLOAT32 = 7           # of sensor_msgs/PointField
MARK = ('written_by', 'somfusion replay')   # in the metadata, by which it may be replaced


class ResultBag(BagWriter):
    """A bag of results; every topic that holds until it is replaced is latched."""

    latched = ('tf_static', 'map', 'global_map', 'clusters')

    def __enter__(self) -> 'Self':
        self._writer.set_custom_data(*MARK)
        return super().__enter__()

    def grid(self, topic: str, stamp: float, frame: str, grid: Grid) -> None:
        """Write a map."""
        header = self._header(stamp, frame)
        info = self._make('nav_msgs/msg/MapMetaData', header.stamp, float(grid.resolution),
                          grid.shape[1], grid.shape[0], self._pose(grid.T_frame_grid))
        self._write(topic, 'nav_msgs/msg/OccupancyGrid', stamp, header, info,
                    grid.to_occupancy().ravel())

    def pose(self, topic: str, frame: str, step: Step) -> None:
        """Write where a robot is."""
        full = np.zeros((6, 6))
        full[np.ix_((0, 1, 5), (0, 1, 5))] = step.covariance
        pose = self._make('geometry_msgs/msg/PoseWithCovariance', self._pose(step.pose),
                          full.ravel())
        self._write(topic, 'geometry_msgs/msg/PoseWithCovarianceStamped', step.stamp,
                    self._header(step.stamp, frame), pose)

    def path(self, topic: str, stamp: float, frame: str, poses: Array) -> None:
        """Write a path through poses (n, 3)."""
        header = self._header(stamp, frame)
        self._write(topic, 'nav_msgs/msg/Path', stamp, header, [
            self._make('geometry_msgs/msg/PoseStamped', header, self._pose(pose))
            for pose in poses])

    def clusters(self, topic: str, stamp: float, frame: str, rows: NDArray[np.float32]) -> None:
        """Write rows (K, 7) of CLUSTER_FIELDS."""
        step = 4 * len(CLUSTER_FIELDS)
        fields = [self._make('sensor_msgs/msg/PointField', name, 4 * i, FLOAT32, 1)
                  for i, name in enumerate(CLUSTER_FIELDS)]
        self._write(topic, 'sensor_msgs/msg/PointCloud2', stamp, self._header(stamp, frame), 1,
                    len(rows), fields, False, step, step * len(rows),
                    np.frombuffer(rows.tobytes(), np.uint8), True)

    def placed(self, stamp: float, parent: str, child: str, pose: Pose) -> None:
        """Write an estimated transform."""
        self.transform('/tf', stamp, parent, child, (pose.x, pose.y, 0.0),
                       quaternion(pose.theta))

    def _pose(self, pose: Array | Pose) -> object:
        """Make a pose in the plane."""
        x, y, theta = (float(value) for value in pose)
        return self._make('geometry_msgs/msg/Pose',
                          self._make('geometry_msgs/msg/Point', x, y, 0.0),
                          self._make('geometry_msgs/msg/Quaternion', *quaternion(theta)))


def refuse_to_replace(folder: Path, read: Iterable[Path]) -> None:
    """Raise InputError where a bag of results would replace one that is read, or a recording."""
    if any(path.resolve() == folder.resolve() or folder.resolve() in path.resolve().parents
           for path in read):
        raise InputError(f'{folder}: the result would replace it; give another --output')
    if folder.exists() and not _is_result(folder / 'metadata.yaml'):
        raise InputError(f'{folder}: exists, and is no bag of an earlier replay; give another '
                         '--output')


def _is_result(metadata: Path) -> bool:
    """Tell whether a bag was written here, by its metadata."""
    try:
        content = yaml.safe_load(metadata.read_text(encoding='utf-8'))
        custom = content['rosbag2_bagfile_information']['custom_data']
        return bool(custom[MARK[0]] == MARK[1])
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError):
        return False


def period_of(durations: list[float]) -> float:
    """Time [s] between two maps."""
    return max(max(durations) / MAPS, SHORTEST_PERIOD)


def write_replay_bag(folder: Path, runs: Mapping[str, RobotRun], config: FusionConfig,
                     result: Fusion) -> Path:
    """
    Write every robot's history, and the global map as it grew; logs of other days shift.

    Maps on the way are laid rigidly; the last is that of the result, which may be bent.
    """
    if folder.exists():
        shutil.rmtree(folder)
    histories = {name: run.history for name, run in runs.items() if run.history is not None}
    shifts = shifts_of({name: history.span() for name, history in histories.items()})
    with ResultBag(folder) as bag:
        for name, history in histories.items():
            _write_robot(bag, name, history, runs[name].log.T_base_laser, shifts[name], config)
        _write_team(bag, histories, shifts, config, result)
    return folder


def shifts_of(spans: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Time [s] to add to each robot's stamps: none where all logs overlap, else to one start."""
    if max(first for first, _ in spans.values()) < min(last for _, last in spans.values()):
        return dict.fromkeys(spans, 0.0)
    start = min(first for first, _ in spans.values())
    return {name: start - first for name, (first, _) in spans.items()}


def _write_robot(bag: ResultBag, name: str, history: History, mount: Pose, shift: float,
                 config: FusionConfig) -> None:
    """Write one robot's poses, transforms, maps, paths and clusters."""
    map_frame, odom, base = (f'{name}/{frame}' for frame in ('map', 'odom', 'base_link'))
    first = history.span()[0] + shift
    bag.transform('/tf_static', first, base, f'{name}/laser', (mount.x, mount.y, 0.0),
                  quaternion(mount.theta))
    for step in history.steps:
        bag.recorded = step.stamp + shift
        bag.pose(f'/{name}/pose', map_frame, step)
        bag.placed(step.stamp, map_frame, odom, step.T_map_odom)
        bag.placed(step.stamp, odom, base, History.T_odom_base(step))
    for stamp, grid, views in history.maps:
        bag.recorded = stamp + shift
        bag.grid(f'/{name}/map', stamp, map_frame, grid)
        bag.path(f'/{name}/path', stamp, map_frame, views)
        rows = cluster_rows(learn(grid, config).clusters)
        bag.clusters(f'/{name}/clusters', stamp, map_frame, rows)


def _write_team(bag: ResultBag, histories: Mapping[str, History], shifts: Mapping[str, float],
                config: FusionConfig, result: Fusion) -> None:
    """Write the global map and the robots' places in it, as they came to be known."""
    times = sorted({t + shifts[name] for name, h in histories.items() for t, _, _ in h.maps})
    cache = FusionCache()
    with progress_bar('global maps', len(times), 'map') as bar:
        for time in times:
            bar.update()
            found = {name: h.map_at(time - shifts[name]) for name, h in histories.items()}
            grids = {name: grid for name, grid in found.items()
                     if grid is not None and grid.occupied.any()}
            if not grids:
                continue
            fusion = (result if time == times[-1] else
                      fuse(grids, config, traced=False, cache=cache))
            bag.recorded = time
            for name, pose in fusion.world.items():
                bag.placed(time, 'world', f'{name}/map', pose)
            bag.grid('/global_map', time, 'world', fusion.global_map)
