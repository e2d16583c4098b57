# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated scanning laser; by default a small one like the Hokuyo URG-04LX."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, compose, Pose
from somfusion_ros.simulation.raycast import raycast
from somfusion_ros.slam.scan import Scan

DROPOUT, DROPOUT_GRAZING = 0.005, 0.3         # chance of no return
GRAZING = np.cos(np.radians(82.0))
GLASS_SEEN = np.cos(np.radians(12.0))         # glass sends light back when met head-on only


@dataclass(frozen=True, eq=False)
class Scene:
    """
    What a laser meets at one moment: segments (S, 4) x0, y0, x1, y1 [m] of each kind.

    Walls send the light back, glass lets it pass unless it is met head-on, and mirrors show what
    stands before them as if it stood behind.
    """

    walls: Array
    glass: Array = field(default_factory=lambda: np.zeros((0, 4)))
    mirrors: Array = field(default_factory=lambda: np.zeros((0, 4)))


@dataclass(frozen=True)
class Laser:
    """
    A laser and its mount T_base_laser.

    beams over field_of_view [rad], reach [m], period [s] between scans, turn [s] of the mirror
    (0: all beams at once), noise [m] and its growth [m / m]; height [m] above the base.
    """

    beams: int = 513
    field_of_view: float = float(np.radians(240.0))
    range_min: float = 0.06
    range_max: float = 4.5
    period: float = 0.1
    turn: float = 0.1
    noise: float = 0.01
    noise_per_metre: float = 0.005
    mount: Pose = Pose(0.145, 0.0, 0.0)
    height: float = 0.25

    @property
    def angle_min(self) -> float:
        """Angle [rad] of the first beam in the laser's frame."""
        return -0.5 * self.field_of_view

    @property
    def angle_increment(self) -> float:
        """Angle [rad] between two beams."""
        return self.field_of_view / (self.beams - 1)

    @property
    def time_increment(self) -> float:
        """Time [s] between two beams."""
        return self.turn * self.angle_increment / (2.0 * np.pi)

    def beam_times(self) -> Array:
        """Time (B,) [s] of every beam after the first."""
        return self.time_increment * np.arange(self.beams)

    def scan(self, stamp: float, scene: Scene, poses: Array, rng: np.random.Generator) -> Scan:
        """Take a scan from the base poses (B, 3) at its beams."""
        return Scan(stamp, self.measure(scene, poses, rng), self.angle_min, self.angle_increment,
                    self.range_min, self.range_max, self.time_increment, self.mount)

    def measure(self, scene: Scene, poses: Array,
                rng: np.random.Generator) -> NDArray[np.float32]:
        """
        Return the ranges (B,) [m] that the laser tells from the base poses (B, 3) at its beams.

        inf where nothing is within reach (REP-117), 0 where the light was lost.
        """
        T_world_laser = compose(poses, self.mount)
        angles = T_world_laser[:, 2] + self.angle_min + self.angle_increment * np.arange(
            self.beams)
        true, incidence = self._first_met(scene, T_world_laser[:, :2], angles)
        noise = rng.normal(size=self.beams)
        chance = rng.uniform(size=self.beams)
        ranges = true + noise * (self.noise
                                 + self.noise_per_metre * np.minimum(true, self.range_max))
        lost = chance < np.where(incidence < GRAZING, DROPOUT_GRAZING, DROPOUT)
        ranges = np.where(ranges > self.range_max, np.inf, np.round(ranges, 3))
        return np.where(lost | (ranges < self.range_min), 0.0, ranges).astype(np.float32)

    def _first_met(self, scene: Scene, origins: Array, angles: Array) -> tuple[Array, Array]:
        """Return the ranges (B,) [m] and incidence (B,) at what sends each beam back."""
        walls = scene.walls[self._within_reach(scene.walls, origins.mean(0))]
        ranges, incidence = raycast(walls, origins, angles)
        if len(scene.glass):
            near, facing = raycast(scene.glass, origins, angles)
            seen = (near < ranges) & (facing > GLASS_SEEN)
            ranges, incidence = np.where(seen, near, ranges), np.where(seen, facing, incidence)
        for mirror in scene.mirrors:
            near, _ = raycast(mirror[None], origins, angles)
            hit = near < ranges
            across = 2.0 * np.arctan2(mirror[3] - mirror[1], mirror[2] - mirror[0])
            ray = np.column_stack([np.cos(angles[hit]), np.sin(angles[hit])])
            behind, facing = raycast(scene.walls, origins[hit] + near[hit, None] * ray,
                                     across - angles[hit])
            ranges[hit], incidence[hit] = near[hit] + behind, facing
        return ranges, incidence

    def _within_reach(self, segments: Array, centre: Array) -> NDArray[np.bool_]:
        """Mask (S,) of the segments that may be nearer than the laser's range."""
        start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
        share = ((centre - start) * along).sum(1) / np.maximum((along ** 2).sum(1), 1e-12)
        nearest = start + along * np.clip(share, 0.0, 1.0)[:, None]
        reach: NDArray[np.bool_] = np.hypot(*(nearest - centre).T) < self.range_max + 0.5
        if not reach.any():
            reach[0] = True   # a ray needs something to miss
        return reach
