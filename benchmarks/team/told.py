# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure what a robot tells of its path: bytes per metre, by kind of fact.

usage: python -m benchmarks.team.told LOG [LOG ...]

Every log is replayed; what is new is packed into a message every 5 s, as slam_node does at its
default map interval. Headers are what remains of the messages; DDS adds its own.
"""

import sys

from benchmarks.tables import Table
import numpy as np
from somfusion_ros.offline.replay import open_logs, ReplayOptions
from somfusion_ros.offline.robot_run import RobotRun, run_robot
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.fact import Fact, LOOP, pack_facts, SCAN, VIEW
from somfusion_ros.team.view_facts import Facts, TICKS
from somfusion_ros.team.view_store import encode_batches

INTERVAL = 5.0                       # [s]
CORNER = 4                           # bytes in memory
EPOCH, TELLING = Epoch('0123456789ab'), '0123ab'     # of the usual lengths
COLUMNS = ('log', 'm', 'views', 'scans between', 'kB/m', 'views [B/m]', 'scans between [B/m]',
           'loops [B/m]', 'a view [B]', 'corners of a view')


def messages(run: RobotRun) -> list[list[Fact]]:
    """Return the facts that are told together."""
    told: dict[int, list[Fact]] = {}
    for fact in run.facts.every:
        stamp = (fact.numbers[1] / TICKS if fact.kind in (VIEW, SCAN) else
                 run.view_stamps[fact.numbers[0]])
        told.setdefault(int(stamp // INTERVAL), []).append(fact)
    return list(told.values())


def row(run: RobotRun) -> list[float]:
    """Return the figures of one log after its name."""
    told, metres = messages(run), float(np.hypot(*np.diff(run.views[:, :2], axis=0).T).sum())
    parts = [sum(len(pack_facts(some)) for group in told
                 if (some := [fact for fact in group if fact.kind == kind]))
             for kind in (VIEW, SCAN, LOOP)]
    whole = sum(len(batch) for group in told
                for batch in encode_batches(EPOCH, TELLING, Facts(tuple(group))))
    corners = [len(view.outline) // CORNER for view in run.facts.views]
    return [metres, len(run.facts.views), len(run.facts.between), whole / metres / 1e3,
            *(part / metres for part in parts), parts[0] / len(run.facts.views),
            float(np.mean(corners))]


def main() -> None:
    """Print a row per log."""
    table = Table('told', COLUMNS, (None, 0, 0, 0, 2, 0, 0, 0, 0, 0))
    for log in open_logs(sys.argv[1:], ReplayOptions()):
        table.add('/'.join(log.path.parts[-2:]), *row(run_robot(log)))
    print(table.markdown())


if __name__ == '__main__':
    main()
