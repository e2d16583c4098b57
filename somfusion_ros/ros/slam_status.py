# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node tells /diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from somfusion_ros.ros.diagnostics import status
from somfusion_ros.slam.slam import Slam, Step

ODOMETRY_OLD = 2.0   # [s] without odometry that are worth a warning


@dataclass
class Last:
    """
    What happened last.

    Stamp and step of the newest scan used, seconds that it took, scans processed so far, when
    odometry was heard [s, steady clock], and scans and time at the last report.
    """

    stamp: Time | None = None
    step: Step | None = None
    scan_seconds: float = 0.0
    scans: int = 0
    odometry_heard: float = float('-inf')
    reported: tuple[int, float] = (0, 0.0)


def slam_status(node: str, namespace: str, last: Last, slam: Slam, faults: Mapping[str, int],
                now: float) -> DiagnosticStatus:
    """Make the status of a slam_node; now [s] is the time of a steady clock."""
    (scans, since), last.reported = last.reported, (last.scans, now)
    age, sigma = now - last.odometry_heard, slam.pose_sigma
    values = {'scans_per_s': (last.scans - scans) / max(now - since, 1e-3),
              'ms_per_scan': 1e3 * last.scan_seconds, 'age_of_odometry_s': age,
              'pose_sigma_x_m': sigma[0], 'pose_sigma_y_m': sigma[1],
              'pose_sigma_yaw_rad': sigma[2], **slam.counters.copy(), **faults}
    warning = ('no odometry yet' if age == float('inf') else
               f'no odometry for {age:.1f} s' if age > ODOMETRY_OLD else
               'no scan could be used yet' if last.step is None else '')
    return status(node, namespace, values, warning)
