# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where services write their files: never two robots into one, and always told in full."""

from pathlib import Path
from typing import Any

ENDINGS = ('.yaml', '.yml', '.pgm', '.npz')


def file_stem(directory: str, name: str, namespace: str, kind: str) -> Path:
    """
    Return the absolute path, without ending, of a file to write or read.

    Parameters
    ----------
    directory : folder that relative names are below; ~ is the home folder
    name : a name, or a path, with or without ending; empty takes namespace and kind
    namespace : of the robot, so that several robots can share a folder
    kind : what is in the file: map, global_map
    """
    words = [*namespace.strip('/').split('/'), kind]
    chosen = name.strip() or '_'.join(word for word in words if word)
    for ending in ENDINGS:
        chosen = chosen.removesuffix(ending)
    path = Path(directory).expanduser() / Path(chosen).expanduser()
    if not chosen or not path.name or chosen.endswith('/'):
        raise ValueError(f'{name!r} names no file')
    return path.resolve()


def requested_name(request: Any) -> str:
    """
    Name that a nav2_msgs/SaveMap request asks for.

    ValueError where it asks for an image or a mode that is not written.
    """
    for field, wanted in (('image_format', ('', 'pgm')), ('map_mode', ('', 'trinary'))):
        if getattr(request, field) not in wanted:
            raise ValueError(f'{field} {getattr(request, field)!r} is not written, only '
                             f'{wanted[-1]}')
    return str(request.map_url)
