# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure a team of robots: bytes on the wire, CPU, latency, and a long life with faults.

usage: python -m benchmarks.team.network wire [ROBOTS ...]
       real nodes, each in a network of its own (default: 2 4 8)
       python -m benchmarks.team.network soak [MINUTES]
       four robots and random faults (default: 30, of simulated time, at 3 times real time)

Both need root for network namespaces. Every robot maps a part of the same building,
and publishes its map every 5 s, as slam_toolbox and slam_node do; all rates are the defaults.
Prints tables, asserts nothing about time.
"""

from collections.abc import Sequence
import os
from pathlib import Path
import signal
import sys
import tempfile
import time

from benchmarks.memory import held_bytes
from benchmarks.tables import Table
from helpers import ROOT, ros_environment
from network import Network, on_network, partition
import numpy as np
from team_lab import Lab, map_of

COUNTS = (2, 4, 8)  # robots of a team
PERIOD = 5.0        # [s] between two maps of a robot
MINUTE = 60.0       # [s] that is measured
SPEED = 3.0         # times real time, of the soak
SAMPLES = 20        # maps whose latency is measured
TICKS = os.sysconf('SC_CLK_TCK')
PROFILE = ROOT / 'config' / 'fastdds_wifi.xml'
DEFAULT_RATES = {'estimation_rate': 0.5, 'merging_rate': 1.0, 'discovery_rate': 0.5,
                 'peer_timeout': 30.0}


def robots(count: int) -> list[str]:
    """Name robots so that their order is that of their numbers."""
    return [f'robot{number}' for number in range(1, count + 1)]


def cpu_seconds(process: int) -> float:
    """CPU time [s] that a process has used."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def node_ids(lab: Lab) -> list[int]:
    """Process ids of the fusion nodes themselves; what starts them has replaced itself."""
    return [process.pid for process in lab.nodes.values()]


def told_by(lab: Lab, robot: str, peer: str) -> int:
    """Bytes that a robot heard of a peer beside its map: states and clusters."""
    status = lab.status(robot, peer)
    return int(status['bytes_received']) - int(status['bytes_of_maps'])


def explore(lab: Lab, count: int, begin: float, end: float, seconds: float,
            speed: float = 1.0) -> None:
    """Let all robots map on for a while, at times real time, in equal steps of progress."""
    steps = round(seconds / PERIOD)
    for step in range(1, steps + 1):
        due = time.monotonic() + PERIOD / speed
        for number, robot in enumerate(robots(count), start=1):
            lab.publish(robot, map_of(number, count, begin + (end - begin) * step / steps))
        lab.pause(max(0.0, due - time.monotonic()))


def latencies(lab: Lab, count: int) -> np.ndarray:
    """Time [s] from a new map of robot1 to the global map of the last robot, several times."""
    last, found = robots(count)[-1], []
    for sample in range(SAMPLES):
        before = lab.ask(last)['global_maps']
        lab.publish('robot1', map_of(1, count, 0.9 + 0.005 * sample))
        start = time.monotonic()
        while lab.ask(last)['global_maps'] == before and time.monotonic() - start < 30.0:
            time.sleep(0.01)
        found.append(time.monotonic() - start)
        time.sleep(1.0 + 0.1 * (sample % 7))
    return np.array(found)


def wire(count: int) -> list[float]:
    """Run a team on a network of its own; return its row of the table after the count."""
    with Network(count) as network, tempfile.TemporaryDirectory() as folder:
        with Lab(Path(folder), on_network(ros_environment(7), PROFILE)) as lab:
            for number, (robot, host) in enumerate(zip(robots(count), network.hosts), start=1):
                lab.add(robot, map_of(number, count, 0.5), host, **DEFAULT_RATES)
            lab.until_equal(robots(count), timeout=180.0)
            told = [told_by(lab, robot, peer) for robot in robots(count)
                    for peer in robots(count) if peer != robot]
            used, sent = [cpu_seconds(p) for p in node_ids(lab)], network.change()
            explore(lab, count, 0.5, 0.9, MINUTE)
            used = np.subtract([cpu_seconds(p) for p in node_ids(lab)], used) / MINUTE
            sent = np.subtract(network.change(), sent) / MINUTE * 60.0
            lab.pause(15.0)
            idle = np.array(network.change())
            lab.pause(30.0)
            idle = np.subtract(network.change(), idle) * 2.0
            took = latencies(lab, count)
            grid = map_of(1, count, 0.7).values.size
    full = grid * 60.0 / PERIOD
    return [np.max(told) / 1e3, sent.mean() / 1e3, idle.mean() / 1e3, full / 1e3,
            full * (count - 1) / 1e3, used.max(), float(np.median(took)),
            float(np.percentile(took, 95))]


def wire_table(counts: Sequence[int] = COUNTS) -> Table:
    """Return what a team costs on the wire, by its size."""
    table = Table('wire', (
        'robots', 'state and clusters per peer, before a match [kB]',
        'a minute while mapping [kB]', 'a minute at rest [kB]',
        'full grids every 5 s, to one node as m-explore has it [kB]', 'to all peers [kB]',
        'CPU of a fusion node [cores]', "peer's new map to own global map, median [s]",
        'p95 [s]'), (None, 0, 0, 0, 0, 0, 2, 1, 1))
    return table.extend([count, *wire(count)] for count in counts)


def soak(minutes: float) -> None:
    """Let four robots map through random faults for a while; print how they are at both ends."""
    rng, count, start = np.random.default_rng(0), 4, time.monotonic()
    with Network(count) as network, tempfile.TemporaryDirectory() as folder:
        with Lab(Path(folder), on_network(ros_environment(7), PROFILE)) as lab:
            for number, (robot, host) in enumerate(zip(robots(count), network.hosts), start=1):
                lab.add(robot, map_of(number, count, 0.5), host)
            lab.until_equal(robots(count), timeout=120.0)
            print('minute  fault                   equal after s  MB of each node', flush=True)
            faults, used, waited = 0, cpu_seconds(node_ids(lab)[0]), []
            state(lab, start, 'none yet', 0.0)
            while SPEED * (time.monotonic() - start) < 60.0 * minutes:
                word = break_something(rng, lab, network, count)
                faults += 1
                explore(lab, count, *rng.uniform(0.5, 1.0, 2), 4 * PERIOD, SPEED)
                network.heal()
                explore(lab, count, 0.9, rng.uniform(0.9, 1.0), PERIOD, SPEED)
                waited.append(lab.until_equal(robots(count), timeout=60.0))
                state(lab, start, word, waited[-1])
            lab.assert_clean()
            passed = time.monotonic() - start
            share = (cpu_seconds(node_ids(lab)[0]) - used) / passed
            print(f'{faults} faults in {SPEED * passed / 60.0:.1f} minutes; equal again after '
                  f'{np.median(waited):.1f} s (median), {max(waited):.1f} s (longest)')
            print(f'CPU of robot1, which lived through all of it: {share:.2f} cores, at '
                  f'{SPEED:.0f} times real time')


def break_something(rng: np.random.Generator, lab: Lab, network: Network, count: int) -> str:
    """Do one random bad thing; say which."""
    robot = robots(count)[rng.integers(1, count)]
    port = robots(count).index(robot)
    kind = rng.integers(6)
    if kind == 0:
        lab.end(robot, signal.SIGKILL)
        lab.start(robot)
        return f'kill -9 of {robot}'
    if kind == 1:
        lab.end(robot)
        lab.start(robot)
        return f'restart of {robot}'
    if kind == 2:
        network.change(groups=partition(count, [p for p in range(count) if p != port]))
        return f'link of {robot} down'
    settings = ({'loss': 0.3}, {'rate': 1e6}, {'duplicate': 0.3, 'reorder': 0.5})[kind - 3]
    network.change(**settings)
    return ', '.join(f'{name} {value:g}' for name, value in settings.items())


def state(lab: Lab, start: float, word: str, waited: float) -> None:
    """Print one row about a team."""
    sizes = ' '.join(f'{held_bytes(process) / 2 ** 20:5.0f}' for process in node_ids(lab))
    minute = SPEED * (time.monotonic() - start) / 60.0
    print(f'{minute:6.1f}  {word:26}{waited:10.1f}      {sizes}', flush=True)


def main() -> None:
    """Measure what was asked for."""
    what, *words = sys.argv[1:] or ['wire']
    if what == 'wire':
        print(wire_table([int(word) for word in words] or COUNTS).markdown())
    elif what == 'soak':
        soak(float(words[0]) if words else 30.0)
    else:
        raise SystemExit(__doc__)


if __name__ == '__main__':
    main()
