# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a team: when pairs are matched, and what is known of the start."""

from dataclasses import dataclass
import math

from somfusion_ros.settings import parameter, SettingError, validate


@dataclass(frozen=True)
class TeamConfig:
    """Parameters of the team as one robot keeps it."""

    estimation_rate: float = parameter(
        0.5, 'Hz', 0.01, 100.0,
        'A pair of robots is matched at most this often; lower it where CPU is scarce.')
    minimum_change: float = parameter(
        0.1, '', 0.0, 1.0,
        'A pair is matched again once this share of the walls of one map is new or gone.')
    known_init_poses: bool = parameter(
        False, '', None, None,
        'Trust initial_poses instead of matching maps; true where the start poses are surveyed.')
    initial_poses: tuple[str, ...] = parameter(
        ('',), 'm, m, rad', None, None,
        'Map frames in one common frame, each as "name x y yaw"; used with known_init_poses.')
    world_anchor: str = parameter(
        '', '', None, None,
        'Robot whose map frame is world wherever it is connected, so that its world never moves; '
        'the same on every robot. Empty: of the connected robots the one whose name sorts first.',
        name='robot')
    robot_radius: float = parameter(
        0.35, 'm', 0.0, 10.0,
        "Walls within this distance of a robot's path, which its own map shows as free, are taken "
        'for its body; the radius of the largest robot and a cell more.')

    robots_visible: bool = parameter(
        False, '', None, None,
        'Refuse transforms by which a laser looked through the place of another robot. True where '
        "lasers see the other robots' bodies; false where they look over them, and where logs are "
        'played together that were recorded one after the other.')

    def __post_init__(self) -> None:
        validate(self)
        self.known_poses()

    def known_poses(self) -> dict[str, tuple[float, float, float]]:
        """Parse initial_poses; SettingError names the one that is not `name x y yaw`."""
        poses = {}
        for text in filter(None, self.initial_poses):
            name, *numbers = text.split()
            try:
                x, y, theta = (float(number) for number in numbers)
                if not all(map(math.isfinite, (x, y, theta))):
                    raise ValueError(numbers)
            except ValueError as error:
                raise SettingError('initial_poses',
                                   f'hold {text!r}, which is not "name x y yaw"') from error
            poses[name] = (x, y, theta)
        return poses
