# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""All maps of a team in, one world out: what the commands replay and merge have in common."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

from somfusion_ros.fusion.alignment import align, Alignment, Trace, trace
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.measures import measure
from somfusion_ros.geometry import between, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.bonding import bond_of, rival_of
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.elastic import ElasticTeam, straighten
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.graph import solve
from somfusion_ros.team.joint_map import draw_joint
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.view_set import ViewSet
from somfusion_ros.team.view_verdict import could_matter, judge_views, RULES


@dataclass(frozen=True, eq=False)
class PairResult:
    """
    The verdict on one pair of maps.

    trace: how it came about, where that was asked for; bond: what the views said, where asked.
    """

    target: str
    source: str
    alignment: Alignment
    trace: Trace | None = None
    bond: Bond | None = None


@dataclass(frozen=True, eq=False)
class Fusion:
    """
    The team's maps in one world.

    world holds T_world_map of the largest connected group, unconnected the other names; V [%]
    of all its overlapping maps, None where it is one map alone. views and elastic: the views of
    the group, and where they lie in the world, None where there are none.
    """

    pairs: list[PairResult]
    solution: Solution
    world: dict[str, Pose]
    unconnected: list[str]
    global_map: Grid
    verification_index: float | None
    views: Mapping[str, ViewSet] = field(default_factory=dict)
    elastic: ElasticTeam | None = None


def fuse(grids: Mapping[str, Grid], config: FusionConfig | None = None, traced: bool = True,
         on_pair: Callable[[], object] = lambda: None,
         cache: FusionCache | None = None,
         views: Mapping[str, ViewSet] | None = None) -> Fusion:
    """
    Align every pair of maps, solve the team's graph, and draw the maps of its largest group.

    Parameters
    ----------
    grids : mapping of str to Grid
        Map by robot.
    config : FusionConfig, optional
        Parameters of the merge.
    traced : bool
        Whether to keep the intermediate products of every pair, for the report.
    on_pair : callable
        Called after every pair.
    cache : FusionCache, optional
        What was learned of the maps before.
    views : mapping of str to ViewSet, optional
        By robot; with them the maps are bent until they fit, without they are summed.

    Returns
    -------
    Fusion
        Pairs, the solution of the graph, T_world_map of its largest group, and the map of that.
    """
    pairs, cache = [], cache or FusionCache()
    names = list(grids)
    for target, source in combinations(names, 2):
        pairs.append(_align(grids, target, source, config, traced, cache))
        on_pair()
    if views:
        confidence = (config or FusionConfig()).estimation_confidence
        pairs = [_asked(pair, views, confidence) for pair in pairs]
    constraints = [MapConstraint(p.target, p.source, p.alignment.T_target_source,
                                 p.alignment.covariance, p.alignment.probability)
                   for p in pairs
                   if p.alignment.accepted and p.alignment.T_target_source is not None]
    solution = solve(names, constraints)
    world = dict(solution.groups[0])
    dropped = {frozenset(item.constraint.robots) for item in solution.dropped}
    bonds = [pair.bond for pair in pairs if pair.bond is not None and pair.alignment.accepted
             and frozenset(pair.bond.pair) not in dropped]
    views = views or {}
    told = world.keys() <= views.keys() and all(len(views[name]) for name in world)
    elastic = straighten(views, world, known=bonds) if told and len(world) > 1 else None
    drawn = (merge_grids(grids, world) if elastic is None else
             draw_joint(views, elastic.poses, min(grids[name].resolution for name in world)))
    return Fusion(pairs, solution, world, [n for n in names if n not in world], drawn,
                  _whole_index(grids, world, config, cache), views, elastic)


def _asked(pair: PairResult, views: Mapping[str, ViewSet], confidence: float) -> PairResult:
    """Weigh the verdict on a pair anew with what its views say, where they can turn it."""
    found, names = pair.alignment, (pair.target, pair.source)
    if (found.T_target_source is None or not could_matter(found.probability, confidence)
            or not {*names} <= views.keys()):
        return pair
    bond, rival = bond_of(views, *names, found.T_target_source), None
    if found.runner_up is not None and found.probability < RULES.clear:
        rival = rival_of(bond, views, found.runner_up.T_target_source)
    return replace(pair, alignment=judge_views(found, bond, rival, confidence), bond=bond)


def _align(grids: Mapping[str, Grid], target: str, source: str, config: FusionConfig | None,
           traced: bool, cache: FusionCache) -> PairResult:
    """Align one pair."""
    maps = grids[target], grids[source]
    alignment = align(*maps, config, cache=cache)
    if not traced:
        return PairResult(target, source, alignment)
    found = trace(*maps, config, cache)
    return PairResult(target, source, alignment, replace(found, alignment=alignment))


def _whole_index(grids: Mapping[str, Grid], world: Mapping[str, Pose],
                 config: FusionConfig | None, cache: FusionCache) -> float | None:
    """Return V [%] (12) of all pairs in the world, each weighed by the area of overlap."""
    total = area = 0.0
    for a, b in combinations(sorted(world), 2):
        maps = [learn(grids[name], config, cache) for name in (a, b)]
        if all(len(one.features) for one in maps):
            evidence, = measure(between(world[a], world[b])[None], maps[0], maps[1])
            shared = evidence.overlap * min(
                grid.known.sum() * grid.resolution ** 2 for grid in (grids[a], grids[b]))
            total, area = total + shared * evidence.V, area + shared
    return min(100.0, float(100.0 * total / area)) if area else None
