# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write doc/constants.md: every tuned number of every stage, with unit, reason and where measured.

usage: python scripts/make_constants.py [doc/constants.md]
"""

from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
import pkgutil
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import somfusion_ros  # noqa: E402

ROOMS = ('slam', 'fusion', 'team', 'io', 'simulation')
HEADER = """# Tuned numbers

Made by `python scripts/make_constants.py` from the code; a test keeps both the same. Parameters
that a user may set are in [config/](../config).
"""


def tunings() -> list[tuple[str, type]]:
    """Return module name and class of every dataclass of tuned numbers, by module."""
    found = []
    for module in pkgutil.walk_packages(somfusion_ros.__path__, 'somfusion_ros.'):
        if module.name.split('.')[1] not in ROOMS:
            continue
        for item in vars(import_module(module.name)).values():
            if (isinstance(item, type) and is_dataclass(item) and item.__module__ == module.name
                    and any('measured' in entry.metadata for entry in fields(item))):
                found.append((module.name.removeprefix('somfusion_ros.'), item))
    return found


def document() -> str:
    """Return the text of doc/constants.md."""
    lines = [HEADER]
    for module, item in tunings():
        lines += [f'## {module}', '', f'{(item.__doc__ or "").strip().splitlines()[0]}', '',
                  '| number | value | unit | why | where measured |', '|---|---|---|---|---|']
        lines += [f'| `{entry.name}` | {entry.default} | {entry.metadata["unit"]} | '
                  f'{entry.metadata["reason"]} | {entry.metadata["measured"]} |'
                  for entry in fields(item)]
        lines.append('')
    return '\n'.join(lines)


if __name__ == '__main__':
    Path(sys.argv[1] if len(sys.argv) > 1 else 'doc/constants.md').write_text(
        document(), encoding='utf-8')
