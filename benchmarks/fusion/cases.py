# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
True pairs of maps, and pairs of different places, by kind: what a verdict must tell apart.

Every case is made of its kind and number alone, so that any one of them can be made again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from zlib import crc32

from benchmarks.data.real_maps import RealMaps
import numpy as np
from somfusion_ros.geometry import apply, Array
from somfusion_ros.grid import Grid

Random = np.random.Generator
MAKERS = 'benchmarks.fusion.true_cases', 'benchmarks.fusion.false_cases'
REAL = ('true', 'team', 'different', 'mesh', 'floors')     # taken as they are, all, and first
NEAR = (0.5, np.radians(5.0))     # right within these [m, rad]


@dataclass
class Case:
    """Two maps; their places; the truth (3,) or None, the spot (2,) where it counts [m, rad]."""

    places: set[str]
    target: Grid
    source: Grid
    truth: Array | None = None
    spot: Array | None = None
    tolerance: tuple[float, float] = NEAR

    def is_right(self, pose: Array | None) -> bool:
        """Tell whether a pose (3,) is the true one; never for different places."""
        if self.truth is None or pose is None:
            return False
        off = np.subtract(*(apply(T, self.spot[None])[0] for T in (pose, self.truth)))
        turn = abs((pose[2] - self.truth[2] + np.pi) % (2.0 * np.pi) - np.pi)
        return bool(np.hypot(*off) < self.tolerance[0] and turn < self.tolerance[1])


Maker = Callable[[RealMaps, Random, int], Case | None]
KINDS: dict[str, tuple[Maker, int]] = {}     # maker of each kind, and how many are learned from


def kind(count: int) -> Callable[[Maker], Maker]:
    """Register a maker under its name."""
    def register(maker: Maker) -> Maker:
        KINDS[maker.__name__] = maker, count
        return maker
    return register


def kinds() -> dict[str, tuple[Maker, int]]:
    """Return the makers of all kinds with how many cases of each there are."""
    for module in MAKERS:     # which register theirs here
        import_module(module)
    return KINDS


def make(name: str, maps: RealMaps, number: int) -> Case | None:
    """Make a case; None where the dice gave nothing usable, or there are no such maps."""
    return kinds()[name][0](maps, np.random.default_rng([crc32(name.encode()), number]), number)
