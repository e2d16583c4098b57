# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The words in which the commands tell what came out."""

from typing import Any

import numpy as np
from somfusion_ros.io.console import say


def tell_robot(name: str, record: dict[str, Any]) -> None:
    """Report how one robot's SLAM went."""
    times = record['milliseconds_per_scan']
    say(f'{name}: {record["scans"]} scans, {record["views"]} views, '
        f'{record["distance"]:.1f} m in {record["recorded_seconds"]:.0f} s; '
        f'{times["median"]:.1f} ms per scan (99 %: {times["p99"]:.1f}), '
        f'{record["real_time_factor"]:.1f} times real time')
    say('  ' + ', '.join(f'{key} {value}' for key, value in record['counters'].items() if value))


def tell_fusion(record: dict[str, Any], map_path: str) -> None:
    """Report which maps were joined, where they lie, and why the others were not."""
    for pair in record['pairs']:
        tell_pair(pair)
    for reason in record['dropped']:
        say(f'dropped: {reason}')
    if len(record['transforms']) > 1:
        for robot, pose in record['transforms'].items():
            say(f'world -> {robot}: {pose_text(pose)}')
        say(f'V of the whole: {number_text(record["verification_index"], ".1f", " %")}; '
            f'global map of {", ".join(record["transforms"])}: {map_path}')
    elif not record['pairs']:
        say(f'map: {map_path}')
    if record['map_note']:
        say(f'{map_path}: {record["map_note"]}')


def tell_found(record: dict[str, Any]) -> None:
    """Report after how many metres a robot was found in the map that it began in."""
    metres = record['found_after_m']
    say('it was not found in the map that it began in: its trajectory is in a frame of its own'
        if metres is None else f'found in the map that it began in after {metres:.1f} m')


def tell_pair(pair: dict[str, Any]) -> None:
    """Report the verdict on a pair, with numbers."""
    verdict = 'accepted' if pair['accepted'] else 'refused'
    say(f'{pair["target"]} <- {pair["source"]}: {verdict}, probability '
        f'{pair["probability"]:.3f}, V {pair["verification_index"]:.1f} %, overlap '
        f'{pair["overlap"]:.2f}, {sum(pair["seconds"].values()):.1f} s')
    say(f'  {pair["reason"]}')
    if 'elastic' in pair:
        say(f'  {"elastic" if pair["elastic"] else "rigid"}: {pair["elastic_reason"]}; '
            f'{pair["views_matched"]} matches, bent by up to {pair["bend_m"]:.2f} m')
    if pair['transform'] is not None:
        say(f'  {"transform" if pair["accepted"] else "best found"}: '
            f'{pose_text(pair["transform"])}')


def pose_text(pose: dict[str, float]) -> str:
    """Write a transform for reading."""
    return (f'x {pose["x"]:.3f} m, y {pose["y"]:.3f} m, '
            f'theta {np.degrees(pose["theta"]):.2f} deg')


def number_text(value: float | None, form: str, unit: str) -> str:
    """Write a number that may be missing."""
    return 'unknown' if value is None else f'{value:{form}}{unit}'
