# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure what a robot costs: CPU and memory of every node of a live team at real rates.

usage: python -m benchmarks.team.live_cpu [ROBOTS] [SECONDS] [RATE] [clock]
       (default: 4 robots, 60 s, at 1 times real time)

Simulated robots (10 scans/s of 683 beams, odometry 25/s) are played in real time into the nodes
that team.launch.py starts, over Fast DDS on this machine. CPU is what the kernel counted for one,
after a while for start-up, in cores; memory is its resident set at the end. With `clock` all nodes
follow the bags' time, which costs each of them some CPU more: then it is also known how old a
peer's views are when the global map shows them first, from the stamp of the scan on. Where the
machine does not keep up a rate below 1 does; rates and CPU are then per second of the bags.
"""

from collections.abc import Iterator
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory
import time

from benchmarks.memory import held_bytes
from benchmarks.tables import Table
import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.ros.apps.demo_team import read_status
from somfusion_ros.ros.apps.processes import node_environment, Processes
from somfusion_ros.simulation.simulate import simulate, SimulationOptions

NODES = ('slam_node', 'fusion_node')
COLUMNS = ('robots', 'scans/s', 'odometry/s', 'scans followed/s', 'slam_node [cores]',
           'fusion_node [cores]', 'slam_node [MB]', 'fusion_node [MB]',
           'views of a peer [kB/min]', 'bonds of a peer [kB/min]', "a peer's view is old [s]",
           'load')
SETTLED = 15.0   # [s] of start-up and discovery that are not counted
TICKS = os.sysconf('SC_CLK_TCK')


def cpu(pid: int) -> float:
    """Return the CPU time [s] of a process so far."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def rates(bag: Path) -> tuple[float, float]:
    """Return scans and odometry messages per second of a bag."""
    with BagReader(bag) as reader:
        counts = [sum(reader.count(topic) for topic in reader.topics(kind)) for kind in (
            'sensor_msgs/msg/LaserScan', 'nav_msgs/msg/Odometry')]
        return counts[0] / reader.duration, counts[1] / reader.duration


def followed(folder: Path, robots: list[str]) -> float:
    """Return how many scans the robots have followed so far, as their diagnostics say; mean."""
    said = read_status(folder)['diagnostics']
    return float(np.mean([float(said.get(f'{robot}/slam_node', {}).get('values', {}).get(
        'scans', 0)) for robot in robots]))


def heard(folder: Path, robots: list[str]) -> Array:
    """Return what the robots heard of a peer so far: views and bonds [kB], and views' age [s]."""
    said = read_status(folder)['diagnostics']
    values = [said.get(f'{robot}/fusion_node: {peer}', {}).get('values', {})
              for robot in robots for peer in robots if peer != robot]
    sizes = [[float(v.get(f'bytes_of_{kind}', 0.0)) / 1e3 for v in values]
             for kind in ('views', 'bonds')]
    told = [size for size in sizes[1] if size > 0.0]      # of a pair one robot tells
    ages = [float(v.get('view_age_s', 'nan')) for v in values]
    known = [age for age in ages if age == age]
    return np.array([np.mean(sizes[0]), np.mean(told or [0.0]),
                     np.median(known) if known else np.nan])


def start(processes: Processes, folder: Path, robots: list[str], clock: bool, rate: float
          ) -> dict[str, list[int]]:
    """Start the nodes of all robots and one player; return process ids by node."""
    pids: dict[str, list[int]] = {node: [] for node in NODES}
    for robot in robots:
        for node in NODES:
            pids[node].append(processes.start(f'{node} {robot}', f'somfusion_ros.ros.{node}', [
                '--ros-args', '-r', f'__ns:=/{robot}', '-r', '/tf:=tf', '-r',
                '/tf_static:=tf_static', '-p', f'use_sim_time:={clock}'.lower()]))
    processes.start('recorder', 'somfusion_ros.ros.apps.recorder', [str(folder / 'live'), *robots])
    processes.start('player', 'somfusion_ros.ros.apps.player', [
        *(str(folder / robot / 'bag') for robot in robots), '--wait', '60', '--rate', str(rate),
        *(['--clock'] if clock else []), '--robots', *robots])
    return pids


def measure(folder: Path, robots: list[str], seconds: float, clock: bool, rate: float
            ) -> Iterator[Array]:
    """
    Yield what was measured, mean over the robots.

    Scans followed per second, which are those played where the machine keeps up; CPU [cores] of
    slam_node and of fusion_node; memory [MB] of both; views and bonds heard of a peer [kB/min],
    the median age [s] of its views when the global map shows them, and the machine's load.
    """
    with Processes(folder / 'logs', node_environment()) as processes:
        pids = start(processes, folder, robots, clock, rate)
        time.sleep(SETTLED)
        before, began = {pid: cpu(pid) for node in NODES for pid in pids[node]}, time.monotonic()
        scans, known = followed(folder / 'live', robots), heard(folder / 'live', robots)
        while time.monotonic() - began < seconds and 'player' not in processes.ended():
            time.sleep(0.5)
        took = rate * (time.monotonic() - began)
        yield np.array([(followed(folder / 'live', robots) - scans) / took])
        yield np.array([np.mean([cpu(pid) - before[pid] for pid in pids[node]]) / took
                        for node in NODES])
        yield np.array([np.mean([held_bytes(pid) / 1e6 for pid in pids[node]]) for node in NODES])
        now = heard(folder / 'live', robots)
        yield np.array([*(60.0 * (now - known)[:2] / took), now[2] if clock else np.nan,
                        os.getloadavg()[0]])


def live_cpu_table(count: int = 4, seconds: float = 60.0, rate: float = 1.0,
                   clock: bool = False) -> Table:
    """Measure a team of simulated robots."""
    table = Table('live-cpu', COLUMNS, (None, 0, 0, 1, 2, 2, 0, 0, 1, 1, 1, 1))
    with TemporaryDirectory() as name:
        folder = Path(name)
        simulate(folder, SimulationOptions(robots=count, seed=1, duration=rate * seconds + 30.0))
        robots = [f'robot{number}' for number in range(1, count + 1)]
        figures = np.concatenate(list(measure(folder, robots, seconds, clock, rate)))
        table.add(count, *rates(folder / 'robot1' / 'bag'), *map(float, figures))
    return table


if __name__ == '__main__':
    words = [word for word in sys.argv[1:] if word != 'clock']
    given = [float(word) for word in words] + [4.0, 60.0, 1.0][len(words):]
    print(live_cpu_table(int(given[0]), *given[1:], clock='clock' in sys.argv).markdown())
