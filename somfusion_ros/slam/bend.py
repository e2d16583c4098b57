# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A robot's own map, straightened by what its peers saw, where the user wants that.

The filter knows nothing of it: what it holds, and what is told of it, stays the robot's own, so
that nothing comes back as news that a peer had from here. Only what is shown is bent.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from somfusion_ros.geometry import apply, Array, compose, fit, inverse, Pose
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.step import Step


@dataclass(frozen=True, eq=False)
class Bend:
    """How far views lie from where the filter has them: T_shown_own (m, 3) by view."""

    T_shown_own: Array = field(default_factory=lambda: np.zeros((1, 3)))

    @classmethod
    def of(cls, own: Array, joint: Array) -> 'Bend':
        """
        Compare views in the own map with where the team's problem has them, in any frame.

        own and joint (m, 3). The map as a whole stays where it is.
        """
        shown = compose(best_rigid(joint, own), joint)
        return cls(compose(shown, inverse(own)))

    def views(self, poses: Array) -> Array:
        """Shift all views from poses (n, 3) to where they are shown, new ones as the last."""
        if not self.T_shown_own.any():
            return poses
        known = np.minimum(np.arange(len(poses)), len(self.T_shown_own) - 1)
        return compose(self.T_shown_own[known], poses)

    def pose(self, view: int, pose: Array) -> Array:
        """Shift what hangs on a view from its place (3,) to where it is shown."""
        return compose(self.T_shown_own[min(view, len(self.T_shown_own) - 1)], pose)

    def step(self, step: Step) -> Step:
        """Return what a scan did, with the poses that are shown."""
        if not self.T_shown_own.any():
            return step
        return replace(step, pose=Pose.from_array(self.pose(step.view, np.array(step.pose))),
                       T_map_odom=Pose.from_array(self.pose(step.view, np.array(step.T_map_odom))))

    def undo(self, pose: Array, poses: Array) -> Array:
        """Return where a pose (3,) that is shown lies in the own map, whose views are at poses."""
        shown = self.views(poses)
        view = int(np.argmin(np.hypot(*(shown[:, :2] - np.asarray(pose)[:2]).T)))
        return compose(inverse(self.pose(view, np.zeros(3))), pose)

    def bodies(self, bodies: Bodies, view: int) -> Bodies:
        """Return other robots where they are in the own map, around a view there."""
        T_own_shown = inverse(self.pose(view, np.zeros(3)))
        return replace(bodies, places=apply(T_own_shown, bodies.places))


def best_rigid(poses: Array, wanted: Array) -> Array:
    """Return the rigid motion (3,) that brings poses (n, 3) nearest to others (n, 3)."""
    return np.array(fit(_ends(poses), _ends(wanted)))


def _ends(poses: Array) -> Array:
    """Return points (2 n, 2) one metre ahead of each pose and behind it."""
    ahead = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return np.concatenate([poses[:, :2] + ahead, poses[:, :2] - ahead])
