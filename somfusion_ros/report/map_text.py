# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A map as coloured characters for a terminal: two pixels, one above the other, in each."""

from collections.abc import Iterable
from typing import NamedTuple

import cv2
from matplotlib.colors import to_hex, to_rgb
import numpy as np
from rich.text import Text
from somfusion_ros.geometry import Array
from somfusion_ros.report.palette import UNKNOWN
from somfusion_ros.report.pictures import Picture

UPPER, LOWER, MARK = '▀', '▄', '●'


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
            above, below = small[2 * line, column], small[2 * line + 1, column]
            if (line, column) in found:
                text.append(MARK, f'bold {found[line, column]}')
            else:
                text.append(*_character(_colour(above), _colour(below)))
        text.append('\n')
    text.rstrip()
    return text


def _shrunk(image: Array, columns: int, rows: int) -> Array:
    """Shrink an image to (rows, columns, 3); dark pixels, the walls, stay visible."""
    step = max(int(np.ceil(max(image.shape[0] / rows, image.shape[1] / columns))), 1)
    dark = cv2.erode(image.astype(np.float32), np.ones((step, step), np.uint8))
    return cv2.resize(dark, (columns, rows), interpolation=cv2.INTER_NEAREST)


def _colour(pixel: Array) -> str:
    """Return a pixel's colour; '' for unknown, which keeps the terminal's own background."""
    if np.allclose(pixel, to_rgb(UNKNOWN), atol=0.01):
        return ''
    red, green, blue = np.clip(pixel, 0.0, 1.0).tolist()
    return to_hex((red, green, blue))


def _character(above: str, below: str) -> tuple[str, str]:
    """Return the character, and its style, that shows one pixel above another."""
    if above and below:
        return UPPER, f'{above} on {below}'
    return (UPPER, above) if above else (LOWER, below) if below else (' ', '')
