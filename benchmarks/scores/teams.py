# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How right a replayed team's robots are placed relative to one another.

The truth comes from the logs' reference.tum, which share one frame: each trajectory is aligned
with its reference. Without any reference the walls say it: of one map's wall cells that fall on
known cells of the other, the share within 0.10 m of a wall there. Where a team's map is elastic,
the joint trajectories and maps are judged, and beside them the maps as they were laid rigidly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

from benchmarks.scores.trajectories import GRACE
import numpy as np
from scipy.spatial import cKDTree
from somfusion_ros.geometry import apply, Array, between, compose, fit, inverse, Pose, wrap
from somfusion_ros.grid import Grid
from somfusion_ros.io.maps import read_map
from somfusion_ros.io.result import read_result
from somfusion_ros.io.trajectories import read_tum

NEAR = 0.10    # [m] within which two walls are one
FEWEST = 20    # cells of wall on the other's known cells from which a share says something


@dataclass(frozen=True)
class TeamScore:
    """
    Two robots of a team: verdict, errors [m], [rad] of the relative pose, share of walls.

    rigid: the share of walls where the robots' own maps are laid together rigidly.
    """

    target: str
    source: str
    connected: bool
    probability: float
    error: float = np.nan
    turn: float = np.nan
    walls: float = np.nan
    rigid: float = np.nan


@dataclass(frozen=True, eq=False)
class Placed:
    """
    One robot of a team, as it lies in `world` and as its reference has it.

    T_world_map; the map; the trajectory in the map, and where the reference knows it: poses (N, 3)
    in the map, positions (N, 2) in the reference's frame. T_world_own, own: the robot's own map,
    laid rigidly; the same where the team's map is not elastic.
    """

    T_world_map: Array | None
    grid: Grid
    T_world_own: Array | None
    own: Grid
    poses: Array
    reference: Array


def score_team(result: Path, logs: Sequence[Path]) -> list[TeamScore]:
    """Judge a folder of `somfusion replay`; one log per robot, in the order of the replay."""
    record = read_result(result)
    known = {(pair['target'], pair['source']): pair for pair in record['pairs']}
    robots = {name: _placed(result / name, record['transforms'].get(name), log)
              for name, log in zip(record['robots'], logs, strict=True)}
    return [_judge(a, b, robots[a], robots[b], known.get((a, b)) or known.get((b, a)))
            for a, b in combinations(robots, 2)]


def walls_agree(target: Grid, source: Grid, T_target_source: Array) -> float:
    """Return the worse direction's share of wall cells near the other's walls; NaN if too few."""
    pairs = (source, target, T_target_source), (target, source, inverse(T_target_source))
    return min((_share(one, other, T) for one, other, T in pairs), key=_nan_first)


def known_overlap(target: Grid, source: Grid, T_target_source: Array) -> tuple[float, Array]:
    """Return the share of the smaller map that both know, and its centre (2,) [m] there."""
    known = apply(T_target_source, source.points(source.known))
    rows, columns = target.point_to_cell(known).T
    inside = (rows >= 0) & (rows < target.shape[0]) & (columns >= 0) & (columns < target.shape[1])
    shared = known[inside][target.known[rows[inside], columns[inside]]]
    areas = [grid.known.sum() * grid.resolution ** 2 for grid in (target, source)]
    share = len(shared) * source.resolution ** 2 / max(min(areas), 1e-9)
    return min(float(share), 1.0), shared.mean(0) if len(shared) else known.mean(0)


def _nan_first(share: float) -> float:
    """Order shares; what is not known comes first."""
    return -1.0 if np.isnan(share) else share


def _share(source: Grid, target: Grid, T_target_source: Array) -> float:
    """Return the share of the source's walls on the target's known cells that lie near walls."""
    walls = apply(T_target_source, source.points(source.occupied))
    known, steps = target.points(target.free | target.occupied), 2.0 * target.resolution
    if not len(walls) or not len(known) or not target.occupied.any():
        return np.nan
    on = cKDTree(known).query(walls, distance_upper_bound=steps)[0] < np.inf
    if on.sum() < FEWEST:
        return np.nan
    apart = cKDTree(target.points(target.occupied)).query(walls[on])[0]
    return float((apart <= NEAR).mean())


def _placed(folder: Path, transform: dict[str, float] | None, log: Path) -> Placed:
    """Read what a replay wrote of one robot, the joint result where there is one."""
    T_world_map = T_world_own = None if transform is None else np.asarray(Pose(**transform))
    joint = T_world_map is not None and (folder / 'joint.tum').exists()
    if joint:   # is drawn and driven in `world` itself
        T_world_map = np.zeros(3)
    stamps, poses = read_tum(folder / ('joint.tum' if joint else 'trajectory.tum'))
    own = read_map(folder / 'map.yaml')
    grid = read_map(folder / 'joint_map.yaml') if joint else own
    when, truth = read_tum(log / 'reference.tum')
    inside = (when >= stamps[0] - GRACE) & (when <= stamps[-1] + GRACE)
    at = np.column_stack([np.interp(when[inside], stamps, axis)
                          for axis in (*poses[:, :2].T, np.unwrap(poses[:, 2]))])
    return Placed(T_world_map, grid, T_world_own, own, at, truth[inside, :2])


def _judge(a: str, b: str, target: Placed, source: Placed,
           pair: dict[str, float] | None) -> TeamScore:
    """Compare the relative pose of two maps with the references'."""
    probability = pair['probability'] if pair else np.nan
    if (target.T_world_map is None or source.T_world_map is None
            or target.T_world_own is None or source.T_world_own is None):
        return TeamScore(a, b, False, probability)
    found = between(target.T_world_map, source.T_world_map)
    T_reference_a, T_reference_b = (fit(one.poses[:, :2], one.reference)
                                    for one in (target, source))
    wanted = between(T_reference_a, T_reference_b)
    middle = np.array([*source.poses[:, :2].mean(0), 0.0])
    off = compose(found, middle) - compose(wanted, middle)
    return TeamScore(a, b, True, probability, float(np.hypot(*off[:2])),
                     float(abs(wrap(found[2] - wanted[2]))),
                     walls_agree(target.grid, source.grid, found),
                     walls_agree(target.own, source.own,
                                 between(target.T_world_own, source.T_world_own)))
