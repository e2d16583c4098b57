# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure how well a robot is found and tracked in the map of another run.

usage: python -m benchmarks.slam.localisation MAP_LOG LOG [MAP_LOG LOG ...]

For every pair of logs of one place, LOG is localised in the map of MAP_LOG, as it is drawn
(map.yaml) and as a state. Compared is with the joint solution of both runs; as joining bends the
map, a pose of it is put back into the map as it was by the map's nearest view. Prints a row per
map: metres driven until it was found, scans at which it was lost, and how far it was off then:
median and 95 % [m] [deg], over the whole run and within 1 m of the map's views. Asserts nothing.
"""

from pathlib import Path
import sys

from benchmarks.tables import Table
import numpy as np
from scipy.spatial import cKDTree
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.io.bags.log import Log, open_log
from somfusion_ros.offline.beginning import Beginning, from_grid
from somfusion_ros.offline.robot_run import RobotRun, run_robot
from somfusion_ros.slam.start import Start

NEAR = 1.0    # [m] from the map's views
STEP = 0.3    # [m] in which a way is measured: the noise of many scans would add to it


class Pair:
    """A log in the map of another one, and where the robot should be in it."""

    def __init__(self, map_log: Log, log: Log) -> None:
        self.log, self._map = log, run_robot(map_log, beginning=Beginning())
        joined = run_robot(log, beginning=Beginning(self._map.checkpoint, Start(anywhere=True)))
        views = self._map.checkpoint.poses
        bent = joined.checkpoint.poses[:len(views)]
        apart, k = cKDTree(bent[:, :2]).query(joined.poses[:, :2])
        self.stamps, self._near = joined.stamps, apart < NEAR
        self._poses = joined.poses
        self._truth = compose(views[k], between(bent[k], joined.poses))

    def beginnings(self) -> dict[str, Beginning]:
        """Return the map as it is drawn, and as a state, to localise in, and to go on in."""
        state = self._map.checkpoint
        return {'map.yaml': from_grid(self._map.grid),
                'state': Beginning(state, Start(anywhere=True, localization=True)),
                'resumed': Beginning(state, Start(anywhere=True))}

    def driven(self, begin: float, end: float) -> float:
        """Return the way [m] driven near the map between two stamps [s]."""
        during = np.flatnonzero((self.stamps >= begin) & (self.stamps <= end))
        total, last = 0.0, self._poses[during[0]]
        for k in during:
            step = float(np.hypot(*(self._poses[k] - last)[:2]))
            if step >= STEP:
                total, last = total + step * self._near[k], self._poses[k]
        return total

    def off(self, run: RobotRun) -> tuple[Array, Array]:
        """Return distances and turns (N, 2) [m] [deg] of a run, and the mask near the map."""
        _, mine, its = np.intersect1d(run.stamps, self.stamps, return_indices=True)
        d = between(self._truth[its], run.poses[mine])
        off = np.column_stack([np.hypot(d[:, 0], d[:, 1]), np.degrees(np.abs(d[:, 2]))])
        kept = run.stamps[mine] > run.found.stamp
        return off[kept], self._near[its][kept]


def main() -> None:
    """Print the table."""
    table = Table('localisation', (
        'log', 'in the map of', 'found after m', 'scans lost', 'median m', '95 % m',
        'median deg', '95 % deg', 'near: median m', '95 % m', 'median deg', '95 % deg'),
        (None, None, 1, None, *[3, 3, 2, 2] * 2))
    for map_path, path in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
        pair = Pair(open_log(map_path), open_log(path))
        for name in ('map.yaml', 'state'):
            run = run_robot(pair.log, beginning=pair.beginnings()[name])
            names = (Path(path).name, f'{Path(map_path).name}, {name}')
            if run.found is None:
                table.extend([(*names, *['never'] + [''] * 9)])
                continue
            off, near = pair.off(run)
            table.extend([(*names, run.found.metres, run.counters.get('lost', 0), *(
                float(np.percentile(part[:, axis], share)) for part in (off, off[near])
                for axis in range(2) for share in (50, 95)))])
    print(table.markdown())


if __name__ == '__main__':
    main()
