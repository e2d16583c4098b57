# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Loop closure at work: new views matched against old places, beside the scan path."""

from collections import Counter
from threading import Lock

import numpy as np
from somfusion_ros.geometry import Array
from somfusion_ros.slam import loop_matching, loops, smoothing
from somfusion_ros.slam.chains import Chains
from somfusion_ros.slam.checkpoint import ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.doubts import Doubts
from somfusion_ros.slam.local_map import LocalMap
from somfusion_ros.slam.loop_trust import Loop, LoopClosure
from somfusion_ros.slam.second_look import SecondLook


class LoopCloser:
    """Closes the loops of the views that wait for it; the lock guards the graph."""

    def __init__(self, graph: ViewGraph, lock: Lock, config: SlamConfig,
                 counters: Counter[str]) -> None:
        self.graph, self.config, self.counters = graph, config, counters
        self.closure = LoopClosure()
        self.doubts = Doubts(graph, counters)
        self._lock = lock
        self._moved = 0.0    # [m] that loops moved the poses since the last re-solving

    def work(self) -> bool:
        """Try to close one waiting view's loops; return whether there was one."""
        with self._lock:
            if not self.graph.to_close:
                return False
            new = self.graph.to_close.popleft()
            graph = self.graph
            self.closure.forget(graph.hidden)
            targets = loops.candidates(new, graph.ekf, np.array(graph.centres), self.config,
                                       self.closure.supposed(new, graph.ekf))
            poses, chains = graph.ekf.poses.copy(), graph.chains
        if targets:
            self._match_loops(new, targets, poses, chains)
        self._relinearise()
        with self._lock:
            if new not in graph.hidden:    # else it was taken back meanwhile
                self.doubts.judge(new, new - self.config.loop_minimum_gap)
        while self._look_again():
            continue
        return True

    def _look_again(self) -> bool:
        """
        Deny a bridge that was not denied if what was seen since fits elsewhere in the map.

        Returns whether there was one.
        """
        with self._lock:
            bridge, graph = self.doubts.take_held(), self.graph
            if bridge is None:
                return False
            look = SecondLook(graph.ekf.poses.copy(), list(graph.clouds), graph.scans.copy(),
                              self.config.resolution)
        if look.elsewhere(bridge.first):
            with self._lock:
                self.doubts.deny(bridge)
        return True

    def _match_loops(self, new: int, targets: list[loops.Candidate], poses: Array,
                     chains: Chains) -> None:
        """Match a view against old places; update the filter by what is trusted."""
        newest, clouds = new - self.config.loop_minimum_gap, self.graph.clouds
        seen = loop_matching.recent(new, chains.of(new), poses, clouds)

        def around(old: int) -> LocalMap:
            own = chains.of(old)
            own = range(own.start, min(own.stop, newest + 1))
            return loop_matching.local_map(old, own, poses, clouds)

        for target in targets:
            found = loop_matching.match(target, new, seen, around, self.config)
            if found is None:
                self.counters['loops_rejected'] += 1
            else:
                self._close(found)

    def _close(self, found: Loop) -> None:
        """Update the filter by the constraints that are trusted now."""
        with self._lock:
            if found.constraint.second in self.graph.hidden:
                return      # the view was taken back while it was matched
            self.closure.forget(self.graph.hidden)
            constraints = self.closure.trusted(found, self.graph.ekf)
            for constraint in constraints:
                self._moved += self.graph.ekf.update(constraint)
                self.graph.constraints.append(constraint)
        self.counters['loops_accepted'] += len(constraints)
        if not constraints:
            self.counters['loops_held_back'] += 1

    def _relinearise(self) -> None:
        """Re-solve the whole problem once loops have moved the poses far."""
        if self._moved < self.config.relinearise_distance:
            return
        with self._lock:
            poses, constraints = self.graph.ekf.poses.copy(), list(self.graph.constraints)
        solved = smoothing.solve(poses, constraints)
        with self._lock:
            self.graph.ekf.relinearise(solved)
            self._moved = 0.0
        self.counters['relinearisations'] += 1
