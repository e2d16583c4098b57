# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The beams of a view in few bytes: what a robot sends its peers of a scan.

Ranges go in whole steps, as differences of neighbouring beams: how many bits each has, which is
compressed, and then these bits without the top one, which no compression makes shorter. Where the
beams point follows from four numbers: the first angle, the step between beams, and how far the
laser moved from one beam to the next. Ranges of a lidar scatter by more than rounding costs.
"""

from dataclasses import dataclass
from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array, Pose, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.scan import Cloud, cloud, Scan
from somfusion_ros.team.compact import pack, pack_scaled, unpack, unpack_scaled


@dataclass(frozen=True)
class BeamLimits:
    """How beams are told, and what is believed of beams that came."""

    step: float = tuned(0.015, 'm', 'of a range that is told; 0.01 costs a tenth more and '
                        'draws no better walls, 0.02 a 20th less', 'shared teams')
    fan: tuple[float, ...] = tuned(
        (1e-4, 1e-4, 1e-5, 1e-8, 1e-7, 1e-7), 'm, m, rad, rad, m, m', 'in which the origin, the '
        'first angle, the step between beams and the shift are told', 'by design')
    largest_step: float = tuned(0.2, 'rad', 'between beams; nothing scans more coarsely',
                                'by design')
    farthest_laser: float = tuned(100.0, 'm', 'from the base; no robot is larger', 'by design')


TUNING = BeamLimits()
MAX_BEAMS = 8192             # of a scan that is told of; more are thinned by their robot
MOST = 65535                 # steps of the longest range
BITS, FLIP = 16, 5           # of a range that is told; and the one that says: hits begin or end
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


def encode_beams(outline: Outline) -> bytes:
    """Pack what a scan saw: 130 to 220 bytes for 180 to 542 beams of a laser."""
    every = -(-len(outline.reach) // MAX_BEAMS)
    if every > 1:
        outline = Outline(outline.ends[::every], outline.reach[::every], outline.hit[::every],
                          outline.origin)
    fan, reach = fan_of(outline), outline.reach
    codes = np.clip(np.rint(reach / TUNING.step), 0, MOST).astype(np.uint16)
    codes[outline.hit] = np.maximum(codes[outline.hit], 1)
    change = np.diff(codes, prepend=np.uint16(0)).view(np.int16)   # modulo 2^16
    zigzag = ((change << 1) ^ (change >> 15)).view(np.uint16)      # small for small changes
    length = np.frexp(zigzag.astype(float))[1].astype(np.uint8)    # bits from the top one on
    flips = np.diff(outline.hit, prepend=True).astype(np.uint8)
    head = pack((len(reach),)) + pack_scaled(
        np.array([*outline.origin, fan.angle, fan.step, fan.shift_x, fan.shift_y]), STEPS_OF_FAN)
    return (head + _compress((length | flips << FLIP).tobytes())
            + np.packbits(_bits(zigzag)[_below_the_top(length)]).tobytes())


def decode_beams(data: bytes) -> Cloud:
    """
    Unpack what `encode_beams` packed into points, normals and outline.

    Raises ValueError, with one line, on anything else; takes no more memory than MAX_BEAMS need.
    """
    try:
        (beams,), rest = unpack(data, 1)
        (x, y, angle, step, *shift), rest = unpack_scaled(rest, STEPS_OF_FAN)
    except ValueError as error:
        raise ValueError('a view is cut short') from error
    if not (0 <= beams <= MAX_BEAMS and max(abs(x), abs(y)) <= TUNING.farthest_laser
            and abs(angle) < LARGEST_ANGLE
            and max(map(abs, (step, *shift))) <= TUNING.largest_step):
        raise ValueError('a view has an unusable geometry')
    reach, hit = _unpacked(rest, beams)
    ranges = np.where(hit, reach, np.where(reach > 0.0, np.inf, np.nan))
    twist = np.array([*shift, 0.0]) / BEAM_TIME
    return cloud(Scan(0.0, ranges, angle, step or 1e-6, 0.0, np.inf, BEAM_TIME, Pose(x, y, 0.0),
                      reach), np.inf, twist)


def _unpacked(packed: bytes, beams: int) -> tuple[Array, NDArray[np.bool_]]:
    """Unpack how far each beam saw (beams,) [m], and whether it returned."""
    unpacker = zlib.decompressobj(wbits=-15)
    try:
        symbols = np.frombuffer(unpacker.decompress(packed, 2 * MAX_BEAMS), np.uint8)
    except zlib.error as error:
        raise ValueError(f'a view is damaged ({error})') from error
    length, flips = symbols & (1 << FLIP) - 1, symbols >> FLIP
    if (len(symbols) != beams or not unpacker.eof or length.max(initial=0) > BITS
            or flips.max(initial=0) > 1):
        raise ValueError('a view is damaged (its beams do not fit its length)')
    below = _below_the_top(length)
    count = int(below.sum())
    if len(unpacker.unused_data) != -(-count // 8):
        raise ValueError('a view is damaged (its ranges do not fit its length)')
    bits = np.arange(BITS) == BITS - length[:, None]
    bits[below] = np.unpackbits(np.frombuffer(unpacker.unused_data, np.uint8), count=count)
    zigzag = np.packbits(bits, axis=1).view('>u2')[:, 0].astype(np.uint16)
    change = ((zigzag >> 1) ^ -(zigzag & 1).astype(np.int16).view(np.uint16)).astype(np.uint16)
    reach = TUNING.step * np.cumsum(change, dtype=np.uint16).astype(float)
    hit = np.cumsum(flips) % 2 == 0
    return reach, hit & (reach > 0.0)


def _bits(values: NDArray[np.uint16]) -> NDArray[np.bool_]:
    """Return the bits (n, 16) of whole numbers (n,), the highest first."""
    return np.unpackbits(values.astype('>u2').view(np.uint8).reshape(-1, 2), axis=1).astype(bool)


def _below_the_top(length: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask the bits (n, 16) below the top one, which is known, of numbers of so many bits (n,)."""
    mask: NDArray[np.bool_] = np.arange(BITS) > BITS - length[:, None].astype(int)
    return mask & (length[:, None] > 0)


def _compress(data: bytes) -> bytes:
    """Deflate without a header, with or without repetitions, whichever is shorter."""
    packed = []
    for strategy in (zlib.Z_DEFAULT_STRATEGY, zlib.Z_HUFFMAN_ONLY):
        packer = zlib.compressobj(9, zlib.DEFLATED, -15, 9, strategy)
        packed.append(packer.compress(data) + packer.flush())
    return min(packed, key=len)
