# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against the robot being where it seems to be, and what is taken back then."""

from collections import Counter, deque
from collections.abc import Sequence

from somfusion_ros.slam import contradiction
from somfusion_ros.slam.bridge import Bridge
from somfusion_ros.slam.bridge import TUNING as BRIDGE
from somfusion_ros.slam.checkpoint import ViewGraph
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.relocation_tuning import TUNING as RELOCATION
from somfusion_ros.slam.view_tuning import TUNING

BRIDGES = 4    # that are judged at a time


class Doubts:
    """
    The newest views, as far as nothing has confirmed them.

    They deny the old ones one by one (`contradiction`), or together those before a view that
    little holds (`bridge`). The graph's lock must be held by who calls.
    """

    def __init__(self, graph: ViewGraph, counters: Counter[str]) -> None:
        self._graph, self._counters = graph, counters
        self._denials = 0     # views that deny old ones, with none between that agrees
        self._unconfirmed: deque[int] = deque(maxlen=contradiction.TUNING.taken_back)
        self._bridges: list[Bridge] = []    # by age
        self._held: list[Bridge] = []       # those that were not denied
        self._weak = False    # whether a scan since the last view hardly fitted
        self._explained = 0.0  # share of the last scan
        self._held_on = True  # whether none did since the last view, old or new
        self._fitted: deque[MapScan] = deque(maxlen=BRIDGE.fitted)

    def follow(self, fits: bool, scan: MapScan | None = None, explained: float = 1.0) -> None:
        """Note whether a scan fits well, where it hangs then, and which share is explained."""
        fell, self._explained = self._explained - explained, explained
        fits = fits and fell < BRIDGE.fell
        self._weak |= not fits
        self._held_on &= fits
        if self._held_on and scan is not None:
            self._fitted.append(scan)

    def go_on(self) -> None:
        """Note that an old view explains what is seen."""
        self._held_on = True

    def add(self, new: int, around: Sequence[int]) -> None:
        """Note a new view, and the views that the scans before it were matched against."""
        if self._weak and len(self._bridges) < BRIDGES and new >= TUNING.known:
            self._bridges.append(Bridge(new, around, tuple(self._fitted)))
        self._weak, self._held_on = False, True

    def judge(self, new: int, last: int) -> None:
        """Count whether a view denies what others, up to the last, saw."""
        ekf, clouds = self._graph.ekf, self._graph.clouds
        if self._judge_bridges(new):
            return
        denies = contradiction.denied(new, last, ekf, clouds)
        if denies is False:
            self._confirm()
            return
        self._unconfirmed.append(new)
        if denies:
            self._denials += 1
            self._counters['views_denied'] += 1

    def _judge_bridges(self, new: int) -> bool:
        """Return whether a view tells of a bridge what to think of it."""
        ekf, clouds = self._graph.ekf, self._graph.clouds
        told = [(bridge, denied) for bridge in self._bridges
                if (denied := bridge.denied(new, ekf, clouds)) is not None]
        for bridge, denied in told:
            if denied:
                self.deny(bridge)
                break
            self._bridges.remove(bridge)
            self._held.append(bridge)
        return bool(told)

    def about(self, view: int) -> bool:
        """Return whether it is in doubt where a view, or the robot, is."""
        return bool(self._bridges) or self._denials > 0 or view in self._unconfirmed

    def take_held(self) -> Bridge | None:
        """
        Return a bridge that was not denied, once.

        None where there is none with as many views since as a search takes.
        """
        enough = self._graph.ekf.n - RELOCATION.views_least
        due = [bridge for bridge in self._held if bridge.first <= enough]
        if not due:
            return None
        self._held.remove(due[0])
        return due[0]

    def take_back(self) -> bool:
        """
        Let views that deny the old ones show nothing any more; return whether there are any.

        With them go all that nothing has confirmed since they came.
        """
        if self._denials < contradiction.TUNING.times:
            return False
        first, n = self._unconfirmed[0], self._graph.ekf.n
        self._graph.hide(range(first, n))
        self._graph.scans.drop(first)
        self._graph.to_close.clear()
        self.clear()
        return True

    def clear(self) -> None:
        """Doubt nothing any more, and judge no bridge: the views since show nothing."""
        self._bridges.clear()
        self._held.clear()
        self._fitted.clear()
        self._confirm()

    def deny(self, bridge: Bridge) -> None:
        """Doubt all views from a bridge on, unless it was taken back meanwhile."""
        if bridge.first in self._graph.hidden:
            return
        self._counters['bridges_denied'] += 1
        self._bridges.clear()
        self._held.clear()
        self._denials = contradiction.TUNING.times
        self._unconfirmed.clear()
        self._unconfirmed.append(bridge.first)

    def _confirm(self) -> None:
        """Doubt nothing any more."""
        self._unconfirmed.clear()
        self._denials = 0
