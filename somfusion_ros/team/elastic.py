# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
One elastic map out of a team's: all robots' own constraints and all bonds, solved together.

Robots whom no bond joins with the others are laid rigidly where the verdicts on the grids have
their maps. Whoever knows the same views and bonds finds the same solution.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np
from somfusion_ros.geometry import Array, between, compose, Pose
from somfusion_ros.slam.bend import best_rigid
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.bonding import bond_of, ElasticSettings
from somfusion_ros.team.constraint import with_drift
from somfusion_ros.team.joint import solve_joint
from somfusion_ros.team.joint_problem import InterMatch
from somfusion_ros.team.view_set import ViewSet


@dataclass(frozen=True, eq=False)
class ElasticTeam:
    """Where all views (n, 3) lie in the world, by robot, and what joins each pair."""

    poses: dict[str, Array]
    bonds: tuple[Bond, ...]


def straighten(robots: Mapping[str, ViewSet], world: Mapping[str, Pose],
               settings: ElasticSettings | None = None, known: Iterable[Bond] = ()
               ) -> ElasticTeam:
    """
    Bend the maps of a connected group so that they fit one another.

    Parameters
    ----------
    robots : views and constraints by robot; those that `world` does not hold are left out
    world : T_world_map by robot, where the accepted pairs have the maps
    settings : of every step
    known : bonds that were found before; other pairs are asked
    """
    robots = {name: robots[name] for name in sorted(world) if len(robots.get(name, ()))}
    found = {frozenset(bond.pair): bond for bond in known}
    bonds = [found.get(frozenset((a, b))) or bond_of(
        robots, a, b, Pose.from_array(between(world[a], world[b])), settings)
        for a, b in combinations(robots, 2)]
    holding = [bond for bond in bonds if bond.holds]
    return ElasticTeam(join(robots, world, holding, settings), tuple(bonds))


class Joined(Protocol):
    """Matches between the views of two robots."""

    @property
    def matches(self) -> tuple[InterMatch, ...]:
        """The matches."""


def join(robots: Mapping[str, ViewSet], world: Mapping[str, Pose], bonds: Iterable[Joined],
         settings: ElasticSettings | None = None, anchor: str = '',
         start: Mapping[str, Array] | None = None) -> dict[str, Array]:
    """
    Solve all constraints; return where all views (n, 3) lie in the world, by robot.

    Parameters
    ----------
    robots : views and constraints by robot
    world : T_world_map by robot, where the accepted pairs have the maps
    bonds : that hold
    settings : of every step
    anchor : the robot whose map stays, at best, where it is; by default the first by name
    start : what was found of a little less, from where a step or two lead to nearly the same
    """
    names = sorted(robots)
    maps = {name: np.array(world[name]) for name in names}
    matches = sorted((m for bond in bonds for m in bond.matches), key=lambda m: (
        m.target, m.source, m.target_view, m.source_view))
    ties = [_tie(robots, maps, names[0], group[0]) for group in _groups(names, matches)[1:]]
    solved = solve_joint(robots, [*matches, *ties], maps,
                         (settings or ElasticSettings()).joint, start).poses
    first = anchor if anchor in robots else names[0]
    back = best_rigid(solved[first], compose(maps[first], robots[first].poses))
    return {name: compose(back, poses) for name, poses in solved.items()}


def astray(robots: Mapping[str, ViewSet], world: Mapping[str, Pose], bond: Joined) -> float:
    """
    Return how far [m] matches have a source's views, in the median, from where the world has them.

    The accepted pairs made the world, and left out whom they contradict: a bond that tells of
    another place is that of a liar.
    """
    target, source = bond.matches[0].target, bond.matches[0].source
    views = np.array([(m.target_view, m.source_view) for m in bond.matches])
    z = np.array([m.z for m in bond.matches])
    off = (compose(world[target], compose(robots[target].poses[views[:, 0]], z))
           - compose(world[source], robots[source].poses[views[:, 1]]))
    return float(np.median(np.hypot(off[:, 0], off[:, 1])))


def _tie(robots: Mapping[str, ViewSet], maps: Mapping[str, Array], anchor: str, robot: str
         ) -> InterMatch:
    """Lay a robot rigidly where the verdicts have its map, by one constraint."""
    middle = len(robots[robot]) // 2
    placed = compose(maps[robot], robots[robot].poses[middle])
    z = between(compose(maps[anchor], robots[anchor].poses[0]), placed)
    return InterMatch(anchor, 0, robot, middle, z, with_drift(Pose.from_array(z),
                                                              np.zeros((3, 3))))


def _groups(names: list[str], matches: Sequence[InterMatch]) -> list[list[str]]:
    """Sort names into groups that matches join, that of the first name first."""
    group = {name: {name} for name in names}
    for m in matches:
        together = group[m.target] | group[m.source]
        group |= dict.fromkeys(together, together)
    return [sorted(one) for one in {min(g): g for g in group.values()}.values()]
