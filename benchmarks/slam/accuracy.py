# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure one robot's SLAM, and its peers, on recorded logs: accuracy, time and memory.

usage: python -m benchmarks.slam.accuracy [LOG ...]
       LOG: a folder with bag/ (default: one of each kind in the data folder, see DATASETS.md)

Prints one row per log and system: scans looked at; relations mean and median and ate [m] where
the log has such references; milliseconds of CPU per scan looked at on the scan path, and per scan
beside it; times real time (bag reading and drawing the map included); peak memory. Each row has a
process of its own. Peers that are not installed (pip install kiss-icp yag-slam) are said once.
Asserts nothing.
"""

from collections.abc import Iterable, Sequence
import json
from pathlib import Path
import subprocess
import sys
import time
from typing import Any

from benchmarks.data.folders import data_folder, ROOT
from benchmarks.memory import peak_megabytes
from benchmarks.scores.trajectories import score
from benchmarks.slam.peers import missing, SYSTEMS
from benchmarks.tables import Table
import numpy as np
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.offline.robot_run import dense, MOST_WAITING, paired, PATIENCE
from somfusion_ros.slam.pairing import Pairing

KINDS = ('intel', 'mit-csail', 'belgioioso', 'mines_exp1', 'wean_run1')
OWN = 'somfusion_ros'


def measure(folder: Path, name: str) -> dict[str, Any]:
    """Replay one log through a system; return what the table shows of it."""
    begin = time.process_time()
    log, system = open_log(folder / 'bag'), SYSTEMS[name]()
    pairing = Pairing(PATIENCE, lambda fault, reason='': None, capacity=MOST_WAITING)
    path, beside, beams = [], [], 0
    for scan, odometry in paired(log, pairing):
        t0 = time.process_time()
        looked = system.process(scan, odometry)
        t1 = time.process_time()
        system.beside()
        if looked:
            path.append(t1 - t0)
        beside.append(time.process_time() - t1)
        pairing.odometry.lag, beams = system.lag, len(scan.ranges)
    system.draw()
    total = time.process_time() - begin
    found = score(folder, *dense(*system.trajectory(), pairing.odometry))
    ms = 1e3 * np.array(path)
    return {'log': folder.name, 'system': name, 'beams': beams, 'scans': len(ms), **found,
            'ms': float(np.median(ms)), 'p99': float(np.percentile(ms, 99)),
            'beside': float(1e3 * np.mean(beside)), 'speed': log.duration / total,
            'MB': peak_megabytes()}


def measured(folder: Path, name: str = OWN) -> dict[str, Any]:
    """Measure in a process of its own, whose peak memory is that of this log and system."""
    run = subprocess.run([sys.executable, '-m', 'benchmarks.slam.accuracy', '--one', str(folder),
                          name], cwd=ROOT, check=True, capture_output=True, text=True)
    return json.loads(run.stdout)


def slam_table(found: Iterable[dict[str, Any]]) -> Table:
    """Return the accuracy of one robot's SLAM, log by log."""
    table = Table('slam', ('log', 'relations, mean [m]', 'median [m]', 'ATE [m]',
                           'times real time'), (None, 4, 4, 3, 0))
    return table.extend((one['log'], one.get('relations mean'), one.get('median'),
                         one.get('ate'), one['speed']) for one in found)


def speed_table(found: Iterable[dict[str, Any]]) -> Table:
    """Return time and memory of one robot's SLAM, log by log."""
    table = Table('speed', ('log', 'beams', 'scans', 'median [ms]', '99th percentile [ms]',
                            'beside [ms]', 'times real time', 'memory [MB]'),
                  (None, 0, 0, 1, 1, 1, 0, 0))
    return table.extend((one['log'], one['beams'], one['scans'], one['ms'], one['p99'],
                         one['beside'], one['speed'], one['MB']) for one in found)


def systems_table(logs: Sequence[str | Path]) -> Table:
    """Return all that is measured, of this package and of its peers that are installed."""
    table = Table('systems', ('log', 'system', 'scans', 'relations, mean [m]', 'median [m]',
                              'ATE [m]', 'ms median', 'p99', 'beside', 'x real time', 'MB'),
                  (None, None, 0, 4, 4, 4, 1, 1, 1, 0, 0))
    for log in logs:
        for name in (name for name in SYSTEMS if not missing(name)):
            one = measured(Path(log).resolve(), name)
            table.add(*(one.get(key) for key in (
                'log', 'system', 'scans', 'relations mean', 'median', 'ate', 'ms', 'p99',
                'beside', 'speed', 'MB')))
    return table


def main() -> None:
    """Measure the logs, or one log with one system."""
    if len(sys.argv) == 4 and sys.argv[1] == '--one':
        print(json.dumps(measure(Path(sys.argv[2]), sys.argv[3])))
        return
    data = data_folder()
    if len(sys.argv) < 2 and data is None:
        raise SystemExit(f'{__doc__}\nno data folder was found')
    for name, why in ((name, missing(name)) for name in SYSTEMS):
        if why:
            print(f'{name}: {why}')
    print(systems_table(sys.argv[1:] or [data / 'logs' / kind for kind in KINDS]).markdown())


if __name__ == '__main__':
    main()
