# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What speaks against the robot being where it seems to be, and what is taken back then."""

from collections import Counter, deque
from collections.abc import Sequence

from somfusion_ros.slam import contradiction
from somfusion_ros.slam.bridge import Bridge
from somfusion_ros.slam.checkpoint import ViewGraph
from somfusion_ros.slam.view_tuning import TUNING


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
        self._bridge: Bridge | None = None
        self._weak = False    # whether a scan since the last view hardly fitted

    def follow(self, fits: bool) -> None:
        """Note whether a scan fits well."""
        self._weak |= not fits

    def add(self, new: int, around: Sequence[int]) -> None:
        """Note a new view, and the views that the scans before it were matched against."""
        if self._weak and self._bridge is None and new >= TUNING.known:
            self._bridge = Bridge(new, around)
        self._weak = False

    def judge(self, new: int, last: int) -> None:
        """Count whether a view denies what others, up to the last, saw."""
        ekf, clouds = self._graph.ekf, self._graph.clouds
        denied = self._bridge.denied(new, ekf, clouds) if self._bridge else None
        if denied is not None:
            if denied and self._bridge:
                self._deny(self._bridge)
            self._bridge = None
            return
        denies = contradiction.denied(new, last, ekf, clouds)
        if denies is False:
            self._confirm()
            return
        self._unconfirmed.append(new)
        if denies:
            self._denials += 1
            self._counters['views_denied'] += 1

    def about(self, view: int) -> bool:
        """Return whether it is in doubt where a view, or the robot, is."""
        return self._bridge is not None or self._denials > 0 or view in self._unconfirmed

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
        self._bridge = None
        self._confirm()
        return True

    def _deny(self, bridge: Bridge) -> None:
        """Doubt all views from a bridge on."""
        self._counters['bridges_denied'] += 1
        self._denials = contradiction.TUNING.times
        self._unconfirmed.clear()
        self._unconfirmed.append(bridge.first)

    def _confirm(self) -> None:
        """Doubt nothing any more."""
        self._unconfirmed.clear()
        self._denials = 0
