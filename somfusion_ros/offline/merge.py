# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion merge`: saved maps in, one stitched map out."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any

from somfusion_ros import __version__
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.io.console import say
from somfusion_ros.io.maps import (image_of, MapError, read_map, refuse_to_overwrite, write_map,
                                   yaml_of)
from somfusion_ros.io.result import fusion_record, make_folder, write_result, write_robot_map
from somfusion_ros.offline.fusing import draw, fuse_with_progress
from somfusion_ros.offline.summary import tell_fusion
from somfusion_ros.team.bent_grids import merge_bent


def merge(paths: Sequence[str | Path], output: str | Path, config: FusionConfig | None = None,
          pictures: bool = True, rigid: bool = False) -> dict[str, Any]:
    """
    Stitch saved maps, and write everything into a folder.

    Parameters
    ----------
    paths : sequence of path
        map_server's YAML files, two or more.
    output : path
        Folder for map.yaml, map.pgm, result.json and the report; made where it is missing.
    config : FusionConfig, optional
        Parameters of the merge.
    pictures : bool
        Whether to draw the report.
    rigid : bool
        Whether to lay the maps together as they are, rather than bend them until they fit.

    Returns
    -------
    dict
        What is in result.json: `pairs`, `transforms` [m, rad] and more.

    Raises
    ------
    MapError
        In one line, where a map or the folder cannot be used, or a map would be overwritten.

    Examples
    --------
    >>> from somfusion_ros.grid import Grid
    >>> for name in ('a', 'b'):
    ...     path = write_map(name, Grid([[1.0, 1.0]], 0.05))     # no wall in either
    >>> record = merge(['a/map.yaml', 'b/map.yaml'], 'out', pictures=False)
    a <- b: refused...
    >>> record['pairs'][0]['accepted'], record['unconnected']
    (False, ['b'])
    """
    started, config = time.perf_counter(), config or FusionConfig()
    files = [yaml_of(Path(path)) for path in paths]
    refuse_twice(files)
    named = dict(zip(map_names(files), files))
    refuse_to_overwrite(files, [Path(output), *(Path(output) / name for name in named)])
    grids = {name: read_map(path) for name, path in named.items()}
    folder = make_folder(output)
    for name, grid in grids.items():
        write_robot_map(folder / name, grid)
    fusion = fuse_with_progress(grids, config, pictures)
    bent = None if rigid or len(fusion.world) < 2 else merge_bent(grids, fusion.world, config)
    write_map(folder, bent.whole if bent else fusion.global_map)
    record = {'command': 'merge', 'version': __version__, 'fusion_config': asdict(config),
              'robots': {name: {'map': str(path)} for name, path in named.items()},
              **fusion_record(fusion),
              'bend_m': bent.bends if bent else {}, 'map': 'map.yaml',
              'seconds': time.perf_counter() - started}
    write_result(folder, record)
    tell_merge(record, folder)
    if pictures:
        draw(folder, fusion)
    return record


def tell_merge(record: dict[str, Any], folder: Path) -> None:
    """Report which maps were joined, where they lie, and how far they were bent."""
    tell_fusion(record, str(folder / 'map.yaml'))
    for name, far in record['bend_m'].items():
        if far:
            say(f'{name} was bent by up to {far:.2f} m')


def refuse_twice(paths: Sequence[Path]) -> None:
    """Raise MapError unless there are two maps: where files name one image, it fits itself."""
    if len(paths) < 2:
        raise MapError('merge needs at least two maps')
    seen: dict[Path, Path] = {}
    for path in paths:
        image = image_of(path).resolve()
        if image in seen:
            raise MapError(f'{seen[image]} and {path} are one map: both name {image.name}')
        seen[image] = path


def map_names(paths: Sequence[Path]) -> list[str]:
    """
    Name maps by file stem.

    Where stems repeat (robot1/map.yaml, robot2/map.yaml) the folder's name stands for the stem,
    and where that repeats too, a number is added.
    """
    stems = [path.stem for path in paths]
    repeated = {stem for stem, count in Counter(stems).items() if count > 1}
    names = []
    for path, stem in zip(paths, stems):
        name = path.resolve().parent.name or stem if stem in repeated else stem
        wanted, number = name, 1
        while name in names:
            number += 1
            name = f'{wanted}_{number}'
        names.append(name)
    return names
