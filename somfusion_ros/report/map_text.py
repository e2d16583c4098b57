# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map as coloured characters for a terminal: two pixels, one above the other, in each."""

from collections.abc import Iterable
from typing import NamedTuple

import cv2
from matplotlib.colors import to_rgb
import numpy as np
from rich.text import Text
from somfusion_ros.geometry import Array
from somfusion_ros.report.palette import BOTH, FREE, UNKNOWN
from somfusion_ros.report.pictures import Picture

UPPER, LOWER, MARK = '▀', '▄', '●'
SHARED = '#808080'   # walls of several robots: seen on a dark terminal and on a light one


class Mark(NamedTuple):
    """A place to point out, such as a robot: where it is [m], and its colour."""

    x: float
    y: float
    colour: str


def map_text(picture: Picture, width: int, height: int, marks: Iterable[Mark] = ()) -> Text:
    """Draw a picture, north up, into at most `width` characters and `height` lines."""
    image, (left, right, bottom, top) = picture
    scale = max(image.shape[1] / width, image.shape[0] / (2 * height))
    columns, rows = (max(int(side / scale), 1) for side in image.shape[1::-1])
    small = _shrunk(image, columns, rows + rows % 2)[::-1]
    found = {}
    for mark in marks:
        column = int((mark.x - left) / (right - left) * columns)
        line = int((top - mark.y) / (top - bottom) * len(small)) // 2
        found[line, column] = mark.colour
    text = Text(no_wrap=True)
    for line in range(len(small) // 2):
        for column in range(columns):
            above, below = (_colour(small[2 * line + k, column]) for k in (0, 1))
            if (line, column) in found:
                ground = f' on {below or above}' if below or above else ''
                text.append(MARK, f'bold {found[line, column]}{ground}')
            else:
                text.append(*_character(above, below))
        text.append('\n')
    text.rstrip()
    return text


def _shrunk(image: Array, columns: int, rows: int) -> Array:
    """
    Shrink an image (H, W, 3) to colours 0xRRGGBB (rows, columns).

    Walls stay visible however thin they are, and no colours are mixed: where walls of several
    colours meet in one character, they are those of several robots.
    """
    colours = _packed(np.rint(255.0 * np.clip(image, 0.0, 1.0)))
    wall = (colours != _colour_number(FREE)) & (colours != _colour_number(UNKNOWN))
    step = max(int(np.ceil(max(image.shape[0] / rows, image.shape[1] / columns))), 1)
    window = np.ones((step, step), np.uint8)
    space = cv2.erode(colours, window)
    first = cv2.erode(np.where(wall, colours, np.float32(np.inf)), window)
    last = cv2.dilate(np.where(wall, colours, np.float32(-1.0)), window)
    found = np.where(last < 0, space, np.where(first == last, first, _colour_number(SHARED)))
    found[found == _colour_number(BOTH)] = _colour_number(SHARED)
    return cv2.resize(found.astype(np.float32), (columns, rows), interpolation=cv2.INTER_NEAREST)


def _packed(channels: Array) -> Array:
    """Write red, green and blue (..., 3) in 0..255 as one number, which a float32 holds."""
    numbers: Array = (channels @ np.array([65536.0, 256.0, 1.0])).astype(np.float32)
    return numbers


def _colour_number(name: str) -> float:
    """Return a colour as `_packed` writes it."""
    return float(_packed(np.rint(255.0 * np.array(to_rgb(name)))))


def _colour(number: float) -> str:
    """Return a colour's name; '' for unknown, which keeps the terminal's own background."""
    return '' if number == _colour_number(UNKNOWN) else f'#{int(number):06x}'


def _character(above: str, below: str) -> tuple[str, str]:
    """Return the character, and its style, that shows one pixel above another."""
    if above and below:
        return UPPER, f'{above} on {below}'
    return (UPPER, above) if above else (LOWER, below) if below else (' ', '')
