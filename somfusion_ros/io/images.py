# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Grey images: PGM in its binary (P5) and its plain (P2) form; others through OpenCV."""

from pathlib import Path
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from somfusion_ros.grid import MAX_CELLS

PNG = b'\x89PNG\r\n\x1a\n'     # how such a file begins


def read_image(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """
    Read an image as shades of grey (H, W), 0..255, and the mask (H, W) of what is opaque.

    OSError or ValueError with the reason.
    """
    data = path.read_bytes()
    if data[:2] in (b'P5', b'P2'):
        shades = _parse_pgm(data)
        return shades, np.ones(shades.shape, bool)
    if data[:8] == PNG and len(data) >= 24:      # its size is read before it is unpacked
        width, height = struct.unpack('>II', data[16:24])
        _check_size(width, height)
    try:
        image = (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data
                 else None)
    except cv2.error as error:
        raise ValueError(f'not a readable image ({" ".join(str(error).split())})') from None
    if image is None:
        raise ValueError('not an image (PGM or PNG expected)')
    _check_size(image.shape[1], image.shape[0])
    return _shades(image)


def _check_size(width: int, height: int) -> None:
    """Raise ValueError where an image is larger than a map can be."""
    if width * height > MAX_CELLS:
        raise ValueError(f'image of {width} x {height} cells is too large')


def _shades(image: NDArray[Any]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the shades (H, W) 0..255 and opacity of an image (H, W) or (H, W, channels)."""
    if image.dtype == np.uint16:
        image = (image // 257).astype(np.uint8)
    if image.dtype != np.uint8:
        raise ValueError(f'image of {image.dtype} is no map')
    opaque = np.ones(image.shape[:2], bool)
    if image.ndim == 3 and image.shape[2] in (2, 4):
        opaque, image = image[..., -1] == 255, image[..., :-1]
    if image.ndim == 3:
        image = image[..., 0] if image.shape[2] == 1 else cv2.cvtColor(
            np.ascontiguousarray(image), cv2.COLOR_BGR2GRAY)
    return image.astype(np.uint8), opaque


def pgm(shades: NDArray[np.uint8]) -> bytes:
    """Return shades (H, W) as binary PGM."""
    height, width = shades.shape
    return b'P5\n%d %d\n255\n' % (width, height) + shades.tobytes()


def _parse_pgm(data: bytes) -> NDArray[np.uint8]:
    """Parse a PGM file; ValueError where it is cut off or contradicts itself."""
    (width, height, largest), body = _header(data)
    if not (0 < width and 0 < height and width * height <= MAX_CELLS and 0 < largest < 65536):
        raise ValueError(f'PGM header makes no sense: {width} x {height}, maximum {largest}')
    count = width * height
    if data[:2] == b'P2':
        try:
            values = np.array(data[body:].split()[:count], dtype=np.int64)
        except (ValueError, OverflowError):
            raise ValueError('PGM holds something that is not a number') from None
    else:
        dtype = np.dtype(np.uint8 if largest < 256 else '>u2')
        available = (len(data) - body) // dtype.itemsize
        values = np.frombuffer(data, dtype, min(count, available), body)
    if len(values) < count:
        raise ValueError(f'truncated: {len(values)} of {width} x {height} cells')
    if values.size and (values.min() < 0 or values.max() > largest):
        raise ValueError(f'PGM holds shades outside 0..{largest}')
    scaled = values if largest == 255 else np.rint(values * (255.0 / largest))
    return scaled.astype(np.uint8).reshape(height, width)


def _header(data: bytes) -> tuple[list[int], int]:
    """Read width, height and largest shade of a PGM file, and where its body starts."""
    numbers: list[int] = []
    at = 2
    while len(numbers) < 3:
        while at < len(data) and (data[at:at + 1].isspace() or data[at:at + 1] == b'#'):
            if data[at:at + 1] == b'#':
                end = data.find(b'\n', at)
                at = len(data) if end < 0 else end
            at += 1
        start = at
        while at < len(data) and data[at:at + 1].isdigit():
            at += 1
        if at == start or at - start > 9:
            raise ValueError('PGM header is cut off or malformed')
        numbers.append(int(data[start:at]))
    return numbers, at + 1
