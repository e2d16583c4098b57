# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A differential-drive robot that follows way points, and what its wheel encoders tell."""

from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Array, compose, wrap
from somfusion_ros.slam.motion import arc

STEP = 0.02                # [s] of the simulation
REST = 1.0                 # [s] standing still before the drive
REACHED = 0.30             # [m] from a way point
ACCELERATION = 0.6         # [m/s^2]
TURN_RATE = 1.0            # [rad/s]
TICK = 2.0 * np.pi / 2000  # [rad] of one encoder tick
SLIP = 0.01                # [m] of a wheel's random slip after one metre


@dataclass(frozen=True)
class Wheels:
    """Radius of the left and the right wheel and their separation [m]."""

    left: float
    right: float
    separation: float


NOMINAL = Wheels(0.077, 0.077, 0.33)


def real_wheels(error: float, rng: np.random.Generator) -> Wheels:
    """
    Draw wheels that differ from the nominal ones by at most a share.

    The radii err together; between left and right only a tenth of it is different, as in a pair
    of wheels of one make.
    """
    radius, difference, separation = 1.0 + error * rng.uniform(-1.0, 1.0, 3) * (1.0, 0.05, 1.0)
    return Wheels(NOMINAL.left * radius * difference, NOMINAL.right * radius / difference,
                  NOMINAL.separation * separation)


def follow(route: Array, heading: float, speed: float, duration: float) -> tuple[Array, Array]:
    """
    Drive along way points (K, 2) [m] until the last one or until the time is up.

    Returns stamps (T,) [s] from 0 and true poses (T, 3).
    """
    pose, velocity, target, poses = np.array([*route[0], heading]), 0.0, 1, []
    for _ in range(int(REST / STEP)):
        poses.append(pose)
    while target < len(route) and len(poses) * STEP < duration:
        dx, dy = route[target] - pose[:2]
        if np.hypot(dx, dy) < REACHED:
            target += 1
            continue
        error = float(wrap(np.arctan2(dy, dx) - pose[2]))
        wanted = speed * max(0.0, 1.0 - abs(error) / 0.9)
        velocity += np.clip(wanted - velocity, -2.0 * ACCELERATION * STEP, ACCELERATION * STEP)
        turn = np.clip(2.0 * error, -TURN_RATE, TURN_RATE)
        pose = compose(pose, arc(velocity * STEP, turn * STEP))
        poses.append(pose)
    return STEP * np.arange(len(poses)), np.array(poses)


def encoders(poses: Array, wheels: Wheels, rng: np.random.Generator,
             slip: float = SLIP) -> Array:
    """
    Return the wheel positions (T, 2) left, right [rad] along true poses (T, 3), in whole ticks.

    Each wheel slips at random: by `slip` [m] after one metre, growing with the root of its
    travel.
    """
    turn = wrap(np.diff(poses[:, 2]))
    chord = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * turn
    travel = chord[:, 0] * np.cos(middle) + chord[:, 1] * np.sin(middle)
    both = np.column_stack([travel - 0.5 * wheels.separation * turn,
                            travel + 0.5 * wheels.separation * turn])
    both += rng.normal(size=both.shape) * slip * np.sqrt(np.abs(both))
    angles = np.cumsum(both / (wheels.left, wheels.right), axis=0)
    return np.rint(np.vstack([np.zeros(2), angles]) / TICK) * TICK


def at(stamps: Array, poses: Array, when: Array) -> Array:
    """Return the poses (N, 3) between poses (T, 3) at times (N,), linear."""
    if len(when):      # look at a part of a drive that may last for hours
        first, last = np.searchsorted(stamps, (when.min(), when.max()))
        near = slice(max(int(first) - 1, 0), int(last) + 1)
        stamps, poses = stamps[near], poses[near]
    heading = np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(when, stamps, poses[:, 0]),
                            np.interp(when, stamps, poses[:, 1]),
                            np.interp(when, stamps, heading)])
