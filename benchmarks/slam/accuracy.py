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

import os
from pathlib import Path
import resource
import sys
import time

from benchmarks.data.folders import data_folder
from benchmarks.scores.trajectories import score
from benchmarks.slam.peers import missing, SYSTEMS
import numpy as np
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.offline.robot_run import dense, MOST_WAITING, paired, PATIENCE
from somfusion_ros.slam.pairing import Pairing

KINDS = ('intel', 'mit-csail', 'belgioioso', 'mines_exp1', 'wean_run1')
SCORES = ('relations mean', 'median', 'ate')


def measure(folder: Path, name: str) -> str:
    """Replay one log through a system; give its row of the table."""
    begin = time.process_time()
    log, system = open_log(folder / 'bag'), SYSTEMS[name]()
    pairing = Pairing(PATIENCE, lambda fault, reason='': None, capacity=MOST_WAITING)
    path, beside = [], []
    for scan, odometry in paired(log, pairing):
        t0 = time.process_time()
        looked = system.process(scan, odometry)
        t1 = time.process_time()
        system.beside()
        if looked:
            path.append(t1 - t0)
        beside.append(time.process_time() - t1)
        pairing.odometry.lag = system.lag
    system.draw()
    total = time.process_time() - begin
    found = score(folder, *dense(*system.trajectory(), pairing.odometry))
    words = ' '.join(f'{found[key]:9.4f}' if key in found else f'{"-":>9}' for key in SCORES)
    ms, memory = 1e3 * np.array(path), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (f'{len(ms):6} {words} {np.median(ms):7.1f} {np.percentile(ms, 99):7.1f} '
            f'{1e3 * np.mean(beside):7.1f} {log.duration / total:8.0f} {memory:6.0f}')


def main() -> None:
    """Measure the logs, or one log with one system."""
    if len(sys.argv) == 4 and sys.argv[1] == '--one':
        folder, name = Path(sys.argv[2]), sys.argv[3]
        print(f'{folder.name:11} {name:24}', measure(folder, name), flush=True)
        return
    logs = sys.argv[1:] or [str(data_folder() / 'logs' / kind) for kind in KINDS]
    absent = {name: missing(name) for name in SYSTEMS}
    for name, why in absent.items():
        if why:
            print(f'{name}: {why}')
    print(f'{"log":11} {"system":24}  scans  rel mean    median       ate  ms med     p99  beside'
          '   x real     MB', flush=True)
    for log in logs:
        for name in (name for name, why in absent.items() if not why):
            os.spawnv(os.P_WAIT, sys.executable,
                      [sys.executable, '-m', 'benchmarks.slam.accuracy', '--one', log, name])


if __name__ == '__main__':
    main()
