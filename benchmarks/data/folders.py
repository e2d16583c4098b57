# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The folder of recorded data: where it lies, and what is in it (DATASETS.md says how to fill it).

    logs/<name>/bag/            a rosbag2 bag, or any other that `somfusion replay` reads
    logs/<name>/reference.tum   true poses T_world_base; logs of one place share the frame
    logs/<name>/relations.txt   true relative poses: t1 t2 x y theta, where they are published
    teams.csv                   team,logs,note: which logs are a team of robots
    pairs*/manifest.csv, *.npz  pairs of maps with the true pose of the source in the target
"""

import csv
from dataclasses import dataclass
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def data_folder(given: str | Path | None = None) -> Path | None:
    """Return the folder that was given, that in SOMFUSION_DATA, or ../shared/data, if any."""
    for folder in (given, os.environ.get('SOMFUSION_DATA'), ROOT.parent / 'shared'):
        for path in (Path(folder), Path(folder) / 'data') if folder else ():
            if (path / 'logs').is_dir():
                return path
    return None


@dataclass(frozen=True)
class RecordedTeam:
    """Logs that form a team of robots; those of different places must be refused."""

    name: str
    logs: tuple[Path, ...]
    note: str

    @property
    def strangers(self) -> bool:
        """Tell whether the logs come from different places."""
        return 'different places' in self.note


def teams(data: Path) -> list[RecordedTeam]:
    """List the teams of a data folder."""
    with open(data / 'teams.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    return [RecordedTeam(row['team'], tuple(data / 'logs' / log for log in row['logs'].split()),
                         row['note']) for row in rows]


def pair_sets(data: Path) -> list[Path]:
    """List the folders of pairs of maps."""
    return sorted(path.parent for path in data.glob('pairs*/manifest.csv'))
