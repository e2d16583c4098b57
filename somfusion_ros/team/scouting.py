# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which peers' whole maps are worth asking for, by the clusters that they tell everybody."""

from collections.abc import Collection
from dataclasses import dataclass

from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.grid import Grid
from somfusion_ros.settings import tuned
from somfusion_ros.team.map_change import missing_walls
from somfusion_ros.team.matchers import Matchers


@dataclass(frozen=True)
class ScoutingTuning:
    """How often a peer is looked at."""

    patience: float = tuned(
        5.0, 's', 'between two looks at the same peer; shorter costs time, longer delays a match',
        'not measured')


TUNING = ScoutingTuning()


@dataclass
class _Peer:
    """A peer's newest clusters, and what they were compared with last."""

    clusters: Clusters
    fresh: bool = True
    own: Grid | None = None
    at: float = float('-inf')


class Scouting:
    """Compares the robot's own map with the clusters of peers that are not wanted yet."""

    def __init__(self, minimum_change: float, cache: FusionCache | None = None,
                 matchers: Matchers = Matchers()) -> None:
        self.likely: set[str] = set()
        self._minimum_change = minimum_change
        self._cache, self._matchers = cache or FusionCache(), matchers
        self._peers: dict[str, _Peer] = {}

    @property
    def unlikely(self) -> set[str]:
        """Peers whose newest clusters were looked at and are like nothing in the own map."""
        return {peer for peer, known in self._peers.items()
                if not known.fresh and peer not in self.likely}

    def update(self, peer: str, clusters: Clusters) -> None:
        """Update the newest clusters of a peer's map."""
        known = self._peers.setdefault(peer, _Peer(clusters))
        known.clusters, known.fresh = clusters, True

    def forget(self, peer: str) -> None:
        """Forget a peer that is gone."""
        self._peers.pop(peer, None)
        self.likely.discard(peer)

    def look_again(self, peer: str) -> None:
        """Compare with a peer's clusters anew: its map is another one, and they may be of that."""
        if peer in self._peers:
            self._peers[peer] = _Peer(self._peers[peer].clusters)

    def look(self, own: Grid | None, wanted: Collection[str], config: FusionConfig,
             now: float) -> str | None:
        """Compare with the one peer that waited longest; return its name, None if none is due."""
        if own is None:
            return None
        waiting = sorted((known.at, peer) for peer, known in self._peers.items()
                         if peer not in wanted and now - known.at >= TUNING.patience)
        for _, peer in waiting:
            known = self._peers[peer]
            known.at = now
            if known.fresh or self._changed(known.own, own):
                known.fresh, known.own = False, own
                if self._matchers.screen(own, known.clusters, config, self._cache).likely:
                    self.likely.add(peer)
                return peer
        return None

    def _changed(self, before: Grid | None, own: Grid) -> bool:
        """Return whether the own map has enough new walls for another look."""
        return before is None or (before is not own
                                  and missing_walls(own, before) >= self._minimum_change)
