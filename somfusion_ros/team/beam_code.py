# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The beams of a view in few bytes: what a robot sends its peers of a scan.

Ranges go in centimetres, as differences of neighbouring beams, compressed. Where the beams point
follows from four numbers: the first angle, the step between beams, and how far the laser moved
from one beam to the next. Ranges of a lidar scatter by more than the half centimetre
that rounding costs.
"""

from dataclasses import dataclass
import struct
import zlib

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, Pose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.scan import Cloud, cloud, Scan


@dataclass(frozen=True)
class BeamLimits:
    """How beams are told, and what is believed of beams that came."""

    step: float = tuned(0.01, 'm', 'of a range that is told; twice as much shows in the scatter '
                        'of the points, half as much costs a bit per beam', 'shared logs')
    largest_step: float = tuned(0.2, 'rad', 'between beams; nothing scans more coarsely',
                                'by design')
    farthest_laser: float = tuned(100.0, 'm', 'from the base; no robot is larger', 'by design')


TUNING = BeamLimits()
MAX_BEAMS = 8192             # of a scan that is told of; more are thinned by their robot
MOST = 65535                 # steps of the longest range
HEADER = struct.Struct('<H6f')   # beams; origin x, y; angle, step, shift x, y
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


def encode_beams(outline: Outline) -> bytes:
    """Pack what a scan saw: 190 to 330 bytes for 180 to 361 beams of a laser."""
    every = -(-len(outline.reach) // MAX_BEAMS)
    if every > 1:
        outline = Outline(outline.ends[::every], outline.reach[::every], outline.hit[::every],
                          outline.origin)
    fan, reach = fan_of(outline), outline.reach
    codes = np.clip(np.rint(reach / TUNING.step), 0, MOST).astype(np.uint16)
    codes[outline.hit] = np.maximum(codes[outline.hit], 1)
    change = np.diff(codes, prepend=np.uint16(0)).view(np.int16)   # modulo 2^16
    zigzag = ((change << 1) ^ (change >> 15)).astype('<u2')        # small for small changes
    planes = zigzag.view(np.uint8).reshape(-1, 2).T.tobytes()
    return (HEADER.pack(len(reach), *outline.origin, fan.angle, fan.step, fan.shift_x, fan.shift_y)
            + _compress(planes + np.packbits(outline.hit).tobytes()))


def decode_beams(data: bytes) -> Cloud:
    """
    Unpack what `encode_beams` packed into points, normals and outline.

    Raises ValueError, with one line, on anything else; takes no more memory than MAX_BEAMS need.
    """
    if len(data) < HEADER.size:
        raise ValueError('a view is cut short')
    beams, x, y, angle, step, *shift = HEADER.unpack_from(data)
    if not (beams <= MAX_BEAMS and np.isfinite([x, y, angle, step, *shift]).all()
            and max(abs(x), abs(y)) <= TUNING.farthest_laser
            and max(map(abs, (step, *shift))) <= TUNING.largest_step):
        raise ValueError('a view has an unusable geometry')
    reach, hit = _unpacked(data[HEADER.size:], beams)
    ranges = np.where(hit, reach, np.where(reach > 0.0, np.inf, np.nan))
    twist = np.array([*shift, 0.0]) / BEAM_TIME
    return cloud(Scan(0.0, ranges, angle, step or 1e-6, 0.0, np.inf, BEAM_TIME, Pose(x, y, 0.0),
                      reach), np.inf, twist)


def _unpacked(packed: bytes, beams: int) -> tuple[Array, NDArray[np.bool_]]:
    """Unpack how far each beam saw (beams,) [m], and whether it returned."""
    unpacker = zlib.decompressobj(wbits=-15)
    try:
        planes = unpacker.decompress(packed, 3 * MAX_BEAMS)
    except zlib.error as error:
        raise ValueError(f'a view is damaged ({error})') from error
    if len(planes) != 2 * beams + -(-beams // 8) or not unpacker.eof or unpacker.unused_data:
        raise ValueError('a view is damaged (its beams do not fit its length)')
    values = np.frombuffer(planes, np.uint8)
    zigzag = values[:2 * beams].reshape(2, -1).T.copy().view('<u2')[:, 0]
    change = ((zigzag >> 1) ^ -(zigzag & 1).astype(np.int16).view(np.uint16)).astype(np.uint16)
    reach = TUNING.step * np.cumsum(change, dtype=np.uint16).astype(float)
    return reach, np.unpackbits(values[2 * beams:], count=beams).astype(bool) & (reach > 0.0)


def _compress(data: bytes) -> bytes:
    """Deflate without a header."""
    packer = zlib.compressobj(9, wbits=-15)
    return packer.compress(data) + packer.flush()
