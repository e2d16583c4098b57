# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The team's problem: every robot's constraints and those between robots, solved together.

The same facts give the same solution, to the bit, on every robot.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from somfusion_ros.geometry import Array, between, compose
from somfusion_ros.team.joint_problem import InterMatch, JointProblem, JointSettings
from somfusion_ros.team.thinning import Spine
from somfusion_ros.team.view_set import ViewSet


@dataclass(frozen=True, eq=False)
class JointSolution:
    """
    Where all views lie in the world.

    poses (n, 3) T_world_view by robot, and per match its squared Mahalanobis distance.
    """

    poses: dict[str, Array]
    chi2: Array


def solve_joint(robots: Mapping[str, ViewSet], matches: Sequence[InterMatch],
                T_world_map: Mapping[str, Array], settings: JointSettings | None = None,
                start: Mapping[str, Array] | None = None) -> JointSolution:
    """
    Solve the constraints of a connected group of robots.

    Parameters
    ----------
    robots : their views and constraints; the first view of the first robot by name stays where
        it is
    matches : constraints between robots
    T_world_map : (3,) by robot, where each robot's map lies about
    settings : how to solve it
    start : a solution (n, 3) by robot of most of it, from which a step or two lead to one that is
        good enough until there is time for the whole
    """
    settings = settings or JointSettings()
    names = sorted(robots)
    total = sum(len(robots[name]) for name in names)
    every = max(settings.every, -(-total // settings.nodes))
    spines = {name: Spine(robots[name].steps, every) for name in names}
    first: dict[str, int] = {}
    nodes: list[Array] = []
    for name in names:
        first[name] = sum(len(part) for part in nodes)
        before = None if start is None else start.get(name)
        nodes.append(_start(robots[name], T_world_map[name], before)[spines[name].nodes])
    problem = JointProblem(settings, [first[name] for name in names])
    for name in names:
        problem.add_robot(robots[name], spines[name], first[name])
    chi2_from = problem.add_matches(matches, spines, first)
    x = problem.solve(np.concatenate(nodes), start is not None)
    poses = {name: spines[name].follow(x[first[name]:first[name] + len(spines[name].nodes)])
             for name in names}
    return JointSolution(poses, problem.chi2(x)[chi2_from])


def settled(views: ViewSet) -> ViewSet:
    """
    Return a robot's views where its own constraints have them.

    A view is told where the robot's map had it then: loops that were closed since moved it there,
    by over a metre in the mines, so that what was told no longer fits the map as it is.
    """
    if not views.loops:
        return views
    return replace(views, poses=solve_joint({'': views}, [], {'': np.zeros(3)}).poses[''])


def _start(views: ViewSet, T_world_map: Array, before: Array | None) -> Array:
    """Return where views (n, 3) lie about: in their map, or on from where they lay before."""
    if before is None or not len(before):
        return compose(np.asarray(T_world_map), views.poses)
    m = min(len(before), len(views))
    new = compose(before[m - 1], between(views.poses[m - 1], views.poses[m:]))
    return np.concatenate([before[:m], new])
