# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Saved maps as Nav2's map_server reads and writes them: a YAML file beside a PGM image."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.grid import FREE, Grid, OCCUPIED, UNKNOWN
from somfusion_ros.io.errors import InputError, reason_of
from somfusion_ros.io.images import pgm, read_image
from somfusion_ros.whole_files import write_files
import yaml

WALL_SHADE, FREE_SHADE, UNKNOWN_SHADE = 0, 254, 205
OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196   # just below the darkness of 205; at 0.25 unknown would be read as free
MODES = ('trinary', 'scale', 'raw')
YAMLS = ('.yaml', '.yml')
IMAGES = ('.pgm', '.png', '.bmp', '.jpg', '.jpeg', '.gif', '.tif', '.tiff')


class MapError(InputError):
    """A saved map cannot be used; one line that names the file and what is wrong."""


def read_map(path: str | Path) -> Grid:
    """
    Read a map_server map.

    Parameters
    ----------
    path : path
        The YAML file; the image is looked for relative to it.

    Returns
    -------
    Grid
        The map as evidence, in metres.

    Raises
    ------
    MapError
        In one line that names the file and what is wrong with it.

    Examples
    --------
    >>> path = write_map('room', Grid(np.array([[1.0, -1.0], [0.0, 1.0]]), 0.05))
    >>> read_map(path).to_occupancy().tolist()
    [[0, 100], [-1, 0]]
    """
    path = yaml_of(Path(path))
    fields = _fields(path)
    image = image_of(path)
    try:
        shades, opaque = read_image(image)
    except (OSError, ValueError) as error:
        raise MapError(f'{image}: {reason_of(error)}') from error
    try:
        return Grid.from_occupancy(
            _cells(shades, opaque, fields)[::-1],   # the first row of an image is its highest y
            float(_field(path, fields, 'resolution')),
            _origin(_field(path, fields, 'origin')))
    except MapError:
        raise
    except (TypeError, ValueError) as error:
        raise MapError(f'{path}: {reason_of(error)}') from error


def _origin(told: Sequence[Any]) -> tuple[float, ...]:
    """Return x, y [m] and yaw [rad] of a map's corner; ValueError where the yaw is in degrees."""
    origin = tuple(float(value) for value in told)
    if len(origin) == 3 and abs(origin[2]) > 2.0 * np.pi + 0.01:
        raise ValueError(f'the yaw of its origin, {origin[2]:g} rad, is over a full turn: '
                         'is it in degrees?')
    return origin


def yaml_of(path: Path) -> Path:
    """
    Find the YAML file that a path means: itself, or the one beside an image that names it.

    MapError where an image has none.
    """
    if path.suffix.lower() not in IMAGES:
        return path
    for candidate in (path.with_suffix('.yaml'), path.with_suffix('.yml'),
                      *sorted(path.parent.glob('*.yaml'))):
        if candidate.is_file():
            try:
                if image_of(candidate).resolve() == path.resolve():
                    return candidate
            except MapError:
                continue
    raise MapError(f'{path}: is an image without a map_server YAML file beside it that names it')


def image_of(path: Path) -> Path:
    """
    Find the image that a YAML file names.

    A path that leads nowhere, as of another computer, falls back to the file beside the YAML.
    """
    name = str(_field(path, _fields(path), 'image'))
    image = path.parent / name
    beside = path.parent / PureWindowsPath(name).name   # which parts at / as well
    return beside if not image.exists() and beside.exists() else image


def _fields(path: Path) -> dict[str, Any]:
    """Read a YAML file's fields; MapError where it is none."""
    try:
        fields = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise MapError(f'{path}: not readable ({reason_of(error)})') from error
    if not isinstance(fields, dict):
        raise MapError(f'{path}: not a map_server YAML file (no key: value lines)')
    return fields


def refuse_to_overwrite(read: Iterable[str | Path], folders: Iterable[Path]) -> None:
    """Raise MapError where map.yaml or map.pgm in these folders is a map that is read."""
    written = {(folder / name).resolve() for folder in folders for name in ('map.yaml', 'map.pgm')}
    for path in map(Path, read):
        for file in (path, *([image_of(path)] if path.suffix.lower() in YAMLS else [])):
            if file.resolve() in written:
                raise MapError(f'{file}: the result would overwrite it; give another --output')


def write_map(folder: str | Path, grid: Grid, name: str = 'map') -> Path:
    """
    Write `<name>.pgm` and `<name>.yaml` (trinary) into a folder, made where missing.

    Cells that are neither clearly wall nor clearly free become unknown. Return the path of the
    YAML file. OSError, as on a full disk, leaves a map that was there as it was.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    shades = np.full(grid.shape, UNKNOWN_SHADE, np.uint8)
    shades[grid.free] = FREE_SHADE
    shades[grid.occupied] = WALL_SHADE
    x, y, theta = (float(v) for v in grid.T_frame_grid)
    image = yaml.safe_dump({'image': f'{name}.pgm'}, allow_unicode=True, width=10 ** 6)
    text = (f'{image}mode: trinary\nresolution: {grid.resolution!r}\n'
            f'origin: [{x!r}, {y!r}, {theta!r}]\nnegate: 0\n'
            f'occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n')
    path = folder / f'{name}.yaml'
    write_files({folder / f'{name}.pgm': pgm(shades[::-1]), path: text.encode()})
    return path


def _cells(image: NDArray[np.uint8], opaque: NDArray[np.bool_],
           fields: Mapping[str, Any]) -> NDArray[np.int8]:
    """
    Return the occupancy cells (H, W), -1 or 0..100, of an image (H, W) by the rules of map_server.

    What is not opaque is unknown, whatever its shade: so map_saver writes it in scale mode.
    """
    mode = str(fields.get('mode', 'trinary')).lower()
    if mode not in MODES:
        raise ValueError(f'mode {mode!r} is none of {", ".join(MODES)}')
    if mode == 'raw':
        return np.where(image <= OCCUPIED, image.astype(np.int16), UNKNOWN).astype(np.int8)
    wall_above = float(fields.get('occupied_thresh', OCCUPIED_THRESHOLD))
    free_below = float(fields.get('free_thresh', FREE_THRESHOLD))
    if not 0.0 <= free_below < wall_above <= 1.0:
        raise ValueError(f'thresholds must rise within 0..1: free_thresh {free_below}, '
                         f'occupied_thresh {wall_above}')
    negate = bool(int(fields.get('negate', 0)))
    shades = np.arange(256) / 255.0
    p = shades if negate else 1.0 - shades
    percent = np.full(256, UNKNOWN, np.int8)
    if mode == 'scale':
        percent[:] = np.rint(100.0 * np.clip((p - free_below) / (wall_above - free_below), 0, 1))
    percent[p > wall_above] = OCCUPIED
    percent[p < free_below] = FREE
    if mode == 'trinary' and not negate:
        # Nav2's map_saver writes 205 for unknown beside free_thresh 0.25, which calls it free.
        percent[UNKNOWN_SHADE] = UNKNOWN
    return np.where(opaque, percent[image], np.int8(UNKNOWN))


def _field(path: Path, fields: Mapping[str, Any], key: str) -> Any:
    """Return a field that must be there."""
    if fields.get(key) is None:
        raise MapError(f'{path}: no {key!r} in the map_server YAML file')
    return fields[key]
