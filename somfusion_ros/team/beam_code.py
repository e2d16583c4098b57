# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The beams of a view as whole numbers: what a robot sends its peers of a scan.

Where the beams point follows from a few numbers: the laser's place, the first angle, the step
between beams, and how far the laser moved from one beam to the next. How far they saw follows
from corners (`outline_code`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from somfusion_ros.geometry import Pose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.team.compact import from_steps, in_steps
from somfusion_ros.team.outline_code import Corners, corners_of, follow


@dataclass(frozen=True)
class BeamLimits:
    """How the geometry of beams is told, and what is believed of beams that came."""

    fan: tuple[float, ...] = tuned(
        (1e-4, 1e-4, 1e-4, 1e-7, 1e-7, 1e-7), 'm, m, rad, rad, m, m', 'in which the origin, the '
        'first angle, the step between beams and the shift are told', 'by design')
    largest_step: float = tuned(0.2, 'rad', 'between beams; nothing scans more coarsely',
                                'by design')
    farthest_laser: float = tuned(100.0, 'm', 'from the base; no robot is larger', 'by design')


TUNING = BeamLimits()
MAX_BEAMS = 8192             # of a scan that is told of; more are thinned by their robot
LARGEST_ANGLE = 100          # [rad]
STEPS_OF_FAN = np.array(TUNING.fan)
BEAM_TIME = 1 / 10_000       # [s] from beam to beam; only the shift in it counts
STEPS = 6                    # of Gauss-Newton for the geometry; three are usual


@dataclass(frozen=True)
class Fan:
    """
    Where the beams of a scan point, in the robot's base frame at the first beam.

    angle [rad] of the first beam, step [rad] between beams, shift x, y [m] of the laser from
    beam to beam. That the robot turned meanwhile is part of the step.
    """

    angle: float
    step: float
    shift_x: float = 0.0
    shift_y: float = 0.0


def fan_of(outline: Outline) -> Fan:
    """Find where the beams of an outline point, by least squares over their ends."""
    used = np.flatnonzero(outline.reach > 0.0)
    if len(used) < 2:
        return Fan(0.0, 0.0)
    arms = outline.ends[used] - outline.origin
    bearings, gaps = np.arctan2(arms[:, 1], arms[:, 0]), np.diff(used)
    steps = wrap(np.diff(bearings))
    step = float(np.median(steps[gaps == gaps.min()]) / gaps.min())
    first = bearings[0] - step * used[0]
    slope, offset = np.polyfit(used, wrap(bearings - first - step * used), 1)
    x, wanted = np.array([first + offset, step + slope, 0.0, 0.0]), arms @ (1.0, 1j)
    for _ in range(STEPS):
        arm = outline.reach[used] * np.exp(1j * (x[0] + x[1] * used))
        J = np.column_stack([1j * arm, 1j * arm * used, used.astype(complex), 1j * used])
        e = wanted - arm - complex(x[2], x[3]) * used
        change = np.linalg.lstsq(np.concatenate([J.real, J.imag]),
                                 np.concatenate([e.real, e.imag]), rcond=1e-9)[0]
        x += change
        if np.abs(change).max() < 1e-9:
            break
    return Fan(*(float(value) for value in x))


def encode_beams(outline: Outline) -> tuple[list[int], Corners]:
    """Return the whole numbers and the corners that tell what a scan saw."""
    every = -(-len(outline.reach) // MAX_BEAMS)
    if every > 1:
        outline = Outline(outline.ends[::every], outline.reach[::every], outline.hit[::every],
                          outline.origin)
    fan = fan_of(outline)
    geometry = np.array([*outline.origin, fan.angle, fan.step, fan.shift_x, fan.shift_y])
    return ([len(outline.reach), *in_steps(geometry, STEPS_OF_FAN)],
            corners_of(outline, fan.step))


def decode_beams(numbers: Sequence[int], corners: Corners) -> Cloud:
    """
    Make points, normals and outline of what `encode_beams` returned.

    Raises ValueError, with one line, on anything else; takes no more memory than MAX_BEAMS need.
    """
    beams, *geometry = numbers
    x, y, angle, step, *shift = from_steps(geometry, STEPS_OF_FAN).tolist()
    if not (0 <= beams <= MAX_BEAMS and max(abs(x), abs(y)) <= TUNING.farthest_laser
            and abs(angle) < LARGEST_ANGLE
            and max(map(abs, (step, *shift))) <= TUNING.largest_step):
        raise ValueError('a view has an unusable geometry')
    reach, hit = follow(corners, beams, step)
    ranges = np.where(hit, reach, np.where(reach > 0.0, np.inf, np.nan))
    twist = np.array([*shift, 0.0]) / BEAM_TIME
    return cloud(Scan(0.0, ranges, angle, step or 1e-6, 0.0, np.inf, BEAM_TIME, Pose(x, y, 0.0),
                      reach), np.inf, twist)
