# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Where two robots were at the same times, told, for one of them whose node knows it no more.

A node that begins anew has not heard where anybody was. The peer that was there all along has,
and what was so stays true as long as both maps live.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.names import robot_name
from somfusion_ros.team.shared_map import TUNING

MOST_ROBOTS = 64         # of which one robot tells,
MOST_PLACES = 8          # and at so many places of each
DIGITS = 2               # of a metre

Places = tuple[tuple[float, float], tuple[float, float]]


class Whereabouts(NamedTuple):
    """
    Where who tells it was [m] when another robot was where, each in its own map.

    robot: the other one; epochs: of the maps of who tells and of the other one.
    """

    robot: str
    epochs: tuple[Epoch, Epoch]
    places: tuple[Places, ...]


def place_record(told: Whereabouts) -> dict[str, Any]:
    """Return what is written of whereabouts."""
    return {'robot': told.robot, 'epochs': [str(epoch) for epoch in told.epochs],
            'places': [[round(number, DIGITS) for place in pair for number in place]
                       for pair in told.places]}


def read_whereabouts(records: Any) -> tuple[Whereabouts, ...]:
    """Read whereabouts; ValueError, TypeError or KeyError where they are none."""
    if not isinstance(records, list) or len(records) > MOST_ROBOTS:
        raise ValueError(f'no list of where at most {MOST_ROBOTS} robots were')
    return tuple(_read(record) for record in records)


def _read(record: Mapping[str, Any]) -> Whereabouts:
    """Read where one robot was."""
    rows, (first, second) = record['places'], record['epochs']
    if not isinstance(rows, list) or len(rows) > MOST_PLACES:
        raise ValueError(f'no list of at most {MOST_PLACES} places')
    return Whereabouts(robot_name(record['robot']), (Epoch.read(first), Epoch.read(second)),
                       tuple(_pair(row) for row in rows))


def _pair(row: Any) -> Places:
    """Read a pair of places."""
    if not isinstance(row, list) or len(row) != 4 or not all(
            type(number) in (int, float) and abs(number) <= TUNING.farthest for number in row):
        raise ValueError('no two places in maps')
    return (float(row[0]), float(row[1])), (float(row[2]), float(row[3]))
