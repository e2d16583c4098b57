# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A team of real fusion nodes, each with a client in the place of its robot."""

from collections.abc import Callable, Collection, Iterable
import json
from pathlib import Path
import resource
import signal
import subprocess
import sys
import time
from types import TracebackType
from typing import Any

from helpers import cut_grid, fake_grid, furnished_room, ros_environment
from network import die_with_parent, Host
import numpy as np
from pace import patient
from robot_client import load_cells, save_cells
from somfusion_ros.geometry import apply, between, compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.ros.apps.processes import free_domain
from somfusion_ros.team.shared_map import MapCells

CLIENT = str(Path(__file__).with_name('robot_client.py'))
FAST = {'estimation_rate': 2.0, 'merging_rate': 2.0, 'discovery_rate': 2.0,
        'peer_timeout': 15.0}
EQUAL = 0.999      # share of the known cells in which all global maps must agree
SHOWN = 0.98       # share of every robot's newest map that they must know, at its true place
SETTLED = 30.0     # [s] after a fault in which they must
START = 40.0       # [s] for a team to find together on a machine under load
WALLS = furnished_room(18.0, 12.0)
SPAN = 18.0


def frame_of(number: int) -> Pose:
    """Pose of the walls in the map frame of a robot: any, but always the same."""
    return Pose(*np.random.default_rng(number).uniform((-5, -5, -3), (5, 5, 3)))


def number_of(robot: str) -> int:
    """Take the number off a robot's name; robot11 is robot1 under another name."""
    return (int(robot.removeprefix('robot')) - 1) % 10 + 1


def map_of(number: int, team: int, progress: float = 1.0) -> MapCells:
    """Map of a robot 1..team: a part of the room that overlaps with its neighbours'."""
    width = min(SPAN, 7.0 + SPAN / team)
    first = (SPAN - width) * (number - 1) / max(team - 1, 1)
    grid = fake_grid(WALLS, T_map_walls=frame_of(number))
    straight = Grid(grid.evidence, grid.resolution, Pose.from_array(
        between(frame_of(number), grid.T_frame_grid)))
    part = cut_grid(straight, (first - 0.5, -1.0), (first + 0.5 + width * progress, 13.0))
    return MapCells(Grid(part.evidence, grid.resolution, grid.T_frame_grid).to_occupancy(),
                    grid.resolution, grid.T_frame_grid)


class Lab:
    """Robots by name, with their processes."""

    def __init__(self, folder: Path, environment: dict[str, str] | None = None) -> None:
        self._folder = folder
        self._environment = environment or ros_environment(free_domain())
        self._clients: dict[str, subprocess.Popen[str]] = {}
        self.nodes: dict[str, subprocess.Popen[bytes]] = {}
        self._prefixes: dict[str, list[str]] = {}
        self._published: dict[str, MapCells] = {}

    def __enter__(self) -> 'Lab':
        """Begin with no robot."""
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """End all processes."""
        for process in self.nodes.values():
            process.send_signal(signal.SIGINT)
        for client in self._clients.values():
            client.stdin.close()
        for process in (*self.nodes.values(), *self._clients.values()):
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def add(self, robot: str, cells: MapCells | None = None, host: Host | None = None,
            **parameters: Any) -> None:
        """Start a robot's client and fusion node, and publish its map."""
        self._prefixes[robot] = host.prefix if host else []
        self._clients[robot] = subprocess.Popen(
            [*self._prefixes[robot], sys.executable, CLIENT, robot], env=self._environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            stderr=self.log(f'{robot}_client').open('ab'), preexec_fn=die_with_parent)
        if cells is not None:
            self.publish(robot, cells)
        self.start(robot, **parameters)

    def start(self, robot: str, namespace: str = '', **parameters: Any) -> None:
        """Start a robot's fusion node; what was heard of an earlier one does not count."""
        if robot in self._clients:
            self.ask(robot, forget=True)
        words = [word for name, value in (FAST | parameters).items()
                 for word in ('-p', f'{name}:={value}')]
        with self.log(robot).open('ab') as log:
            self.nodes[robot] = subprocess.Popen(
                [*self._prefixes.get(robot, []), sys.executable, '-m',
                 'somfusion_ros.ros.fusion_node', '--ros-args', '-r',
                 f'__ns:=/{namespace or robot}', '-r', '/diagnostics:=diagnostics', *words],
                env=self._environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL,
                preexec_fn=die_with_parent)

    def run(self, name: str, program: str, *arguments: str) -> None:
        """Start another program of this folder, to be ended like a fusion node."""
        with self.log(name).open('ab') as log:
            self.nodes[name] = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name(program)), *arguments],
                env=self._environment, stdout=log, stderr=log, stdin=subprocess.DEVNULL,
                preexec_fn=die_with_parent)

    def memory(self, robot: str) -> float:
        """Tell the memory [MB] that a robot's fusion node holds."""
        pages = int(Path(f'/proc/{self.nodes[robot].pid}/statm').read_text().split()[1])
        return pages * resource.getpagesize() / 2 ** 20

    def end(self, robot: str, number: int = signal.SIGINT) -> int:
        """End a robot's fusion node by a signal; return its status."""
        process = self.nodes.pop(robot)
        process.send_signal(number)
        return process.wait(10.0)

    def remove(self, robot: str) -> int:
        """End a whole robot; return the status of its fusion node."""
        client = self._clients.pop(robot)
        client.communicate(timeout=10.0)
        return self.end(robot)

    def log(self, name: str) -> Path:
        """Path of a process's log."""
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder / f'{name}.log'

    def ask(self, robot: str, **command: Any) -> dict[str, Any]:
        """Return a robot's client a command; return what it heard so far."""
        client = self._clients[robot]
        client.stdin.write(json.dumps(command) + '\n')
        client.stdin.flush()
        return json.loads(client.stdout.readline())

    def publish(self, robot: str, cells: MapCells, stamp: float = 1.0) -> None:
        """Publish a robot's map."""
        path = self._folder / f'{robot}_map.npz'
        self._folder.mkdir(parents=True, exist_ok=True)
        save_cells(path, cells)
        self._published[robot] = cells
        self.ask(robot, map=str(path), stamp=stamp)

    def status(self, robot: str, peer: str = '') -> dict[str, str]:
        """Return the newest diagnostics of a robot's fusion node, or of what it says of a peer."""
        return self.ask(robot)['status'].get(peer, {})

    def global_map(self, robot: str) -> MapCells | None:
        """Return a robot's newest global map."""
        path = self._folder / f'{robot}_global.npz'
        path.unlink(missing_ok=True)
        self.ask(robot, global_map=str(path))
        return load_cells(path) if path.exists() else None

    def connected(self, robot: str) -> set[str]:
        """Name the robots that a robot is connected with, itself among them."""
        return set(self.status(robot).get('connected', '').split(', ')) - {'nobody', ''}

    def until(self, condition: Callable[[], Any], what: Callable[[], str],
              timeout: float = SETTLED) -> float:
        """Wait for a condition; return the time [s] that it took."""
        start = time.monotonic()
        while not condition():
            self.assert_alive()
            assert patient(timeout, start), (f'not within {timeout} s: {what()}\n'
                                             f'{self.diagnostics()}\n{self.words()}')
            time.sleep(0.5)
        return time.monotonic() - start

    def pause(self, seconds: float) -> None:
        """Let time pass; every process must live through it."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.assert_alive()
            time.sleep(0.5)

    def equal_within(self, robots: Iterable[str]) -> bool:
        """Tell whether some robots show the same global map now."""
        maps = [self.global_map(robot) for robot in robots]
        return all(equal_share(maps[0], other) >= EQUAL for other in maps)

    def until_equal(self, robots: Iterable[str], team: Iterable[str] | None = None,
                    timeout: float = SETTLED, others: Collection[str] = ()) -> float:
        """Wait until robots are connected with all of a team and show the same global map."""
        robots, worst = sorted(robots), {}
        team = set(team or robots)

        def equal() -> bool:
            worst['connected'] = {robot: sorted(self.connected(robot)) for robot in robots}
            if any(set(found) - set(others) != team for found in worst['connected'].values()):
                return False
            maps = [self.global_map(robot) for robot in robots]
            if any(one is None for one in maps):
                return False
            worst['equal'] = [equal_share(maps[0], other) for other in maps]
            worst['shown'] = {robot: round(self._shown(maps[0], robot, min(team)), 4)
                              for robot in sorted(team)}
            return min(worst['equal']) >= EQUAL and min(worst['shown'].values()) >= SHOWN
        return self.until(equal, lambda: f'the global maps of {robots} equal, of all of '
                          f'{sorted(team)}: {worst}', timeout)

    def _shown(self, merged: MapCells, robot: str, world: str) -> float:
        """Share of what a robot published last that a global map knows, at its true place."""
        cells = self._published[robot]
        grid, whole = (Grid.from_occupancy(c.values, c.resolution, c.T_frame_grid)
                       for c in (cells, merged))
        T_world_map = compose(frame_of(number_of(world)), inverse(frame_of(number_of(robot))))
        at = whole.point_to_cell(apply(T_world_map, grid.points(grid.known)))
        inside = ((at >= 0) & (at < whole.shape)).all(1)
        return float(whole.known[tuple(at[inside].T)].sum() / len(at))

    def assert_alive(self) -> None:
        """Check that every process that was started runs."""
        dead = [robot for robot, process in self.nodes.items() if process.poll() is not None]
        assert not dead, f'{dead} died\n{self.words()}'

    def assert_clean(self) -> None:
        """Check that no node said that anything in it failed."""
        for robot in self._prefixes:
            words = self.log(robot).read_text()
            for fault in ('Traceback', 'error in a callback', 'worker_errors'):
                assert fault not in words, f'{robot}: {words[-3000:]}'

    def diagnostics(self) -> str:
        """Return what every robot says of itself and of its peers."""
        return '\n'.join(f'--- {robot}, of {peer or "itself"}: {values}'
                         for robot in sorted(self._clients)
                         for peer, values in sorted(self.ask(robot)['status'].items()))

    def words(self) -> str:
        """Return the last words of every process."""
        return '\n'.join(f'--- {path.name}\n{path.read_text()[-1500:]}'
                         for path in sorted(self._folder.glob('*.log')))


def equal_share(one: MapCells, other: MapCells) -> float:
    """Share of the cells known in either of two global maps that are the same in both."""
    corners = [np.rint(np.array(cells.T_frame_grid[1::-1]) / cells.resolution).astype(int)
               for cells in (one, other)]
    low = np.min(corners, 0)
    size = np.max([corner + cells.values.shape
                   for corner, cells in zip(corners, (one, other))], 0) - low
    laid = np.full((2, *size), -1, np.int8)
    for canvas, corner, cells in zip(laid, corners - low, (one, other)):
        (row, column), (height, width) = corner, cells.values.shape
        canvas[row:row + height, column:column + width] = cells.values
    known = (laid != -1).any(0)
    return float((laid[0] == laid[1])[known].mean()) if known.any() else 1.0
