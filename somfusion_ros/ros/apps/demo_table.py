# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a live team published, beside a reference, in words and numbers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from somfusion_ros.geometry import between, inverse, Pose
from somfusion_ros.io.bags.log import Log
from somfusion_ros.io.result import pose_record

TOLERANCE = (0.5, 5.0)   # [m], [deg]: beyond it a merge is wrong, not inexact
References = Mapping[tuple[str, str], Pose]


@dataclass(frozen=True)
class Row:
    """
    One relative transform as one robot published it.

    T_target_source; reference or None; after: when it was first published [s after the first
    pose]; V [%], probability and milliseconds of the last attempt as text of the robot's
    diagnostics, '' where it says nothing.
    """

    target: str
    source: str
    T_target_source: Pose
    reference: Pose | None
    after: float
    verification_index: str
    probability: str
    milliseconds: str

    @property
    def error(self) -> tuple[float, float] | None:
        """Distance [m] and angle [deg] to the reference."""
        if self.reference is None:
            return None
        x, y, theta = between(self.reference, self.T_target_source)
        return float(np.hypot(x, y)), float(np.degrees(abs(theta)))

    def within(self, tolerance: tuple[float, float]) -> bool:
        """Return whether the error is within a distance [m] and an angle [deg]."""
        return self.error is not None and all(e <= t for e, t in zip(self.error, tolerance))

    def record(self) -> dict[str, Any]:
        """Describe the row for a JSON file."""
        return {'target': self.target, 'source': self.source,
                'transform': pose_record(self.T_target_source),
                'reference': pose_record(self.reference), 'error': self.error,
                'after': self.after, 'verification_index': self.verification_index,
                'probability': self.probability, 'milliseconds': self.milliseconds}


def compare(status: Mapping[str, Any], reference: References | None) -> list[Row]:
    """Put every published transform beside the reference, robot by robot."""
    rows = []
    for robot, record in status['robots'].items():
        begin = (record['first_pose'] or {}).get('first', 0.0)
        for child, transform in record['transforms'].items():
            peer = child.rpartition('/')[0]
            said = pair_diagnostics(status, robot, peer)
            rows.append(Row(robot, peer, Pose.from_array(transform['pose']),
                            _reference(reference, robot, peer), transform['first'] - begin,
                            said.get('V', ''), said.get('probability', ''),
                            said.get('ms_per_attempt', '')))
    return rows


def table(rows: Sequence[Row], reference_name: str) -> list[str]:
    """Lay the rows out: each transform above its reference."""
    head = ('map of -> map of', 'x [m]', 'y [m]', 'theta [deg]', 'error [m]', '[deg]', 'V [%]',
            'probability', 'match [ms]', 'after [s]')
    cells: list[tuple[str, ...]] = [head]
    for row in rows:
        error = ('', '') if row.error is None else tuple(f'{e:.3f}' for e in row.error)
        cells.append((f'{row.target} -> {row.source}', *_pose_cells(row.T_target_source), *error,
                      row.verification_index, row.probability, row.milliseconds,
                      f'{row.after:.1f}'))
        if row.reference is not None:
            cells.append((f'  {reference_name}', *_pose_cells(row.reference), *6 * ('',)))
    widths = [max(len(line[i]) for line in cells) for i in range(len(head))]
    return ['  '.join(c.ljust(w) if i == 0 else c.rjust(w)
                      for i, (c, w) in enumerate(zip(line, widths))).rstrip() for line in cells]


def robot_lines(status: Mapping[str, Any], logs: Mapping[str, Log]) -> Iterator[str]:
    """List what each robot published."""
    for robot, record in status['robots'].items():
        maps, said = record['maps'], status['diagnostics'].get(f'{robot}/slam_node', {})
        values = said.get('values', {})
        team = status['diagnostics'].get(f'{robot}/fusion_node', {}).get('values', {})
        yield (f'{robot}: {values.get("scans", "?")} of {logs[robot].scan_count} scans, '
               f'{values.get("ms_per_scan", "?")} ms for the last one, '
               f'{values.get("loops_accepted", "0")} loops closed; '
               f'{_map_text("map", maps["map"])}; {_map_text("global map", maps["global_map"])}; '
               f'{team.get("transform_jumps", "?")} transforms changed by over 0.2 m or 2 deg')


def pair_diagnostics(status: Mapping[str, Any], robot: str, peer: str) -> dict[str, str]:
    """Return the diagnostics of one peer by a robot."""
    for name, record in status['diagnostics'].items():
        words = name.replace('/', ' ').replace(':', ' ').split()
        if robot in words and peer in words and words.index(robot) < words.index(peer):
            return dict(record['values'])
    return {}


def _reference(reference: References | None, target: str, source: str) -> Pose | None:
    """Find a reference, given in either direction."""
    if reference is None:
        return None
    if (target, source) in reference:
        return reference[target, source]
    turned = reference.get((source, target))
    return None if turned is None else Pose.from_array(inverse(turned))


def _map_text(kind: str, record: Mapping[str, Any]) -> str:
    """Write how often a map was published and how large it is."""
    return f'{record["count"]} times a {kind}, last {record["width"]} x {record["height"]} cells'


def _pose_cells(pose: Pose) -> tuple[str, str, str]:
    """Write x [m], y [m], theta [deg]."""
    return f'{pose.x:.3f}', f'{pose.y:.3f}', f'{np.degrees(pose.theta):.2f}'
