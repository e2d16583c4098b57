# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `somfusion watch` shows of a team: its maps as they merge, and how each robot is doing."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from rich.console import Console, Group
from rich.panel import Panel
from rich.table import Table
from rich.text import Text
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.report.map_text import map_text, Mark
from somfusion_ros.report.palette import team_colours
from somfusion_ros.report.pictures import overlay_picture

LEVELS = {0: 'green', 1: 'yellow', 2: 'red', 3: 'red'}   # of diagnostic_msgs/DiagnosticStatus
FRAME = 4      # columns and lines that the frame and title of a panel take
LARGEST_TABLE = 0.4   # share of the terminal's lines in which states are told whole
FEWEST = 8     # lines of a map, however small the terminal is


@dataclass(frozen=True)
class Health:
    """One status of /diagnostics: its level, its message, its values."""

    level: int
    message: str
    values: Mapping[str, str]


@dataclass
class HeardTeam:
    """
    What was heard of a team.

    By robot: its map, its pose T_map_base, and T_map_peer of the peers that it accepted; and the
    health of every node and pair, by the name of its status.
    """

    grids: dict[str, Grid] = field(default_factory=dict)
    poses: dict[str, Pose] = field(default_factory=dict)
    transforms: dict[str, dict[str, Pose]] = field(default_factory=dict)
    health: dict[str, Health] = field(default_factory=dict)

    def groups(self) -> list[dict[str, Pose]]:
        """Return T_world_map of each connected group, in the map of its first robot by name."""
        left, groups, near = sorted(self.grids), [], self._neighbours()
        while left:
            group, queue = {left[0]: Pose()}, deque([left[0]])
            while queue:
                owner = queue.popleft()
                for peer, T_owner_peer in near[owner].items():
                    if peer not in group:
                        group[peer] = Pose.from_array(compose(group[owner], T_owner_peer))
                        queue.append(peer)
            groups.append(group)
            left = [robot for robot in left if robot not in group]
        return groups

    def _neighbours(self) -> dict[str, dict[str, Pose]]:
        """Return T_map_peer of each robot with a map, also as the peer alone tells it."""
        near: dict[str, dict[str, Pose]] = {robot: {} for robot in self.grids}
        told = [(owner, peer, T) for owner, peers in self.transforms.items()
                for peer, T in peers.items() if {owner, peer} <= near.keys()]
        for owner, peer, T_owner_peer in told:   # a robot without a fusion node tells none
            near[peer][owner] = Pose.from_array(inverse(T_owner_peer))
        for owner, peer, T_owner_peer in told:
            near[owner][peer] = T_owner_peer
        return near


def view(team: HeardTeam, width: int, height: int) -> Group:
    """Compose the view of a team for a terminal of `width` x `height` characters."""
    table, rows, groups = *fitting_table(team, width, height), team.groups()
    if not groups:
        return Group(Text('no robot has published a map yet'), table)
    lines = max(height - rows - 2 * FRAME, FEWEST)
    columns = max(width // len(groups) - FRAME, 2 * FEWEST)
    maps = Table.grid(padding=(0, 1))
    maps.add_row(*(map_panel(team, group, columns, lines) for group in groups))
    return Group(maps, table)


def map_panel(team: HeardTeam, group: Mapping[str, Pose], width: int, height: int) -> Panel:
    """Draw the maps of connected robots as one, each robot's walls in its colour."""
    colours = team_colours(sorted(team.grids))
    picture = overlay_picture([(team.grids[r], pose, colours[r]) for r, pose in group.items()])
    robots = [robot for robot in group if robot in team.poses]
    places = [compose(group[robot], team.poses[robot]) for robot in robots]
    marks = [Mark(place[0], place[1], colours[robot]) for robot, place in zip(robots, places)]
    title = Text(' + ').join(Text(robot, f'bold {colours[robot]}') for robot in group)
    title.append(': one map, shared walls grey' if len(group) > 1 else ': not merged', 'default')
    return Panel.fit(map_text(picture, width, height, marks), title=title)


def fitting_table(team: HeardTeam, width: int, height: int) -> tuple[Table, int]:
    """Return the table with whole sentences if it leaves room for the maps, and its lines."""
    whole = health_table(team, whole=True)
    lines = len(Console(width=width, height=height).render_lines(whole)) - 1   # one is the head
    if lines <= LARGEST_TABLE * height:
        return whole, lines
    return health_table(team), len(team.health)


def health_table(team: HeardTeam, whole: bool = False) -> Table:
    """List every node and pair with its state and the reason for it, each in a line or whole."""
    table = Table(box=None, padding=(0, 2, 0, 0), expand=True)
    table.add_column('who', no_wrap=True, min_width=max(map(len, team.health), default=3))
    for column, ratio in (('state', 1), ('figures', 1)):
        table.add_column(column, overflow='fold' if whole else 'ellipsis', no_wrap=not whole,
                         ratio=ratio)
    for name, health in sorted(team.health.items()):
        table.add_row(name, Text(health.message, LEVELS.get(health.level, 'red')),
                      figures(health.values))
    return table


def figures(values: Mapping[str, str]) -> str:
    """Select the few numbers that say most."""
    chosen = ('scans_per_s', 'views', 'loops_accepted', 'probability', 'overlap', 'V', 'map_age_s')
    return ', '.join(f'{name} {values[name]}' for name in chosen if name in values)
