# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The team as one robot knows it at one moment, for other threads: it never changes."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.shared_map import SharedMap
from somfusion_ros.team.solution import Solution
from somfusion_ros.team.whereabouts import Whereabouts
from somfusion_ros.team.world import anchored, anchored_covariances


@dataclass(frozen=True)
class Snapshot:
    """
    The team as it is known now.

    own_transforms: T_own_peer of the pairs that the robot itself accepted, as the views have them
    where they came; constraints: the same without views, with covariances, as peers are told;
    solution: where all maps lie; verdicts: the newest alignment with each peer; words: what became
    of it; settled: the peers on whose present maps the last word is said; wanted: the peers whose
    whole maps are of use; departed, departed_maps:
    robots that are gone, with their maps; sources: who has the map of a robot that is gone; jumps:
    accepted transforms that changed by much; anchor: the robot whose map frame `world` is where
    it is connected; world_changes: how often `world` changed for this robot; doubted: peers whose
    accepted pose was refused on the maps of now; epoch: which map the robot itself has, None
    before the first; begun: how often every robot began another map; placed: T_world_map by robot
    of the connected team, as the views place it where they came; whereabouts: where the robot was
    when others were where; refuted: peers whose bonds the own views contradict; given: which map
    of the robot the user's initial pose is of; denied: maps of which such poses are not;
    suspected: peers that say what cannot be, or are joined by one word alone, with a sentence.
    """

    own_transforms: dict[str, Pose] = field(default_factory=dict)
    constraints: tuple[MapConstraint, ...] = ()
    solution: Solution = field(default_factory=lambda: Solution((), {}))
    verdicts: dict[str, Alignment] = field(default_factory=dict)
    words: dict[str, str] = field(default_factory=dict)
    settled: frozenset[str] = frozenset()
    wanted: frozenset[str] = frozenset()
    departed: tuple[DepartedRobot, ...] = ()
    departed_maps: Mapping[str, SharedMap] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    jumps: int = 0
    anchor: str = ''
    world_changes: int = 0
    doubted: frozenset[str] = frozenset()
    epoch: Epoch | None = None
    begun: Mapping[str, int] = field(default_factory=dict)
    placed: Mapping[str, Pose] = field(default_factory=dict)
    whereabouts: tuple[Whereabouts, ...] = ()
    refuted: tuple[str, ...] = ()
    given: Epoch | None = None
    denied: Mapping[str, Epoch] = field(default_factory=dict)
    suspected: Mapping[str, str] = field(default_factory=dict)

    def lookouts(self, robot: str) -> list[Pose]:
        """Return poses in a robot's own map from where a look would settle ambiguous verdicts."""
        found = [verdict.lookout_target if robot < peer else verdict.lookout_source
                 for peer, verdict in sorted(self.verdicts.items())]
        return [pose for pose in found if pose is not None]

    def world(self, robot: str) -> dict[str, Pose]:
        """Return T_world_map by robot of the connected team; of itself while it is alone."""
        if robot in self.placed:
            return dict(self.placed)
        return anchored(self.solution.group_of(robot), self.anchor)

    def covariances(self, robot: str) -> dict[str, Array]:
        """Return the covariance (3, 3) of T_world_map by robot of the connected team."""
        return anchored_covariances(self.solution.group_of(robot), self.solution.covariances,
                                    self.anchor)

    def connected(self, robot: str) -> list[str]:
        """Return the robots of the connected team; none while the robot is alone."""
        group = self.solution.group_of(robot)
        return sorted(group) if len(group) > 1 else []
