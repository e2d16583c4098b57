# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node publishes on /diagnostics."""

from collections.abc import Mapping
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from somfusion_ros.ros.common.conversions import seconds
from somfusion_ros.ros.common.diagnostics import status
from somfusion_ros.slam.slam import Slam
from somfusion_ros.slam.step import Step

SILENT = 2.0          # [s] without scans or odometry that are worth a warning
EXTRAPOLATED = 10.0   # [s] that map -> odom is taken to hold without a scan that could be used


@dataclass
class Last:
    """
    What happened last.

    Stamp and step of the newest scan used, stamp of the newest scan heard, seconds that a scan
    took, scans processed so far, when scans and odometry were heard [s, steady clock], what the
    newest scan lacked, whether new scans are left out, which map is waited for, whether the robot
    ever had a place in its map, why the last state was not saved, by how much odometry comes late
    [s], why nothing was heard, and scans and time at the last report.
    """

    stamp: Time | None = None
    step: Step | None = None
    heard_stamp: Time | None = None
    scan_seconds: float = 0.0
    scans: int = 0
    scan_heard: float = float('-inf')
    odometry_heard: float = float('-inf')
    lacking: str = ''
    paused: bool = False
    awaited: str = ''
    placed: bool = True
    not_saved: str = ''
    odometry_late: float = 0.0
    hint: str = ''
    reported: tuple[int, float] = (0, 0.0)

    @property
    def present(self) -> Time | None:
        """
        Stamp at which map -> odom holds: of the newest scan heard.

        Where that one is not used, for a moment or while new scans are left out, the transform
        is still the best that is known, and who navigates needs one. A stray stamp does not count.
        """
        if self.stamp is None or self.heard_stamp is None:
            return self.stamp
        ahead = seconds(self.heard_stamp) - seconds(self.stamp)
        return self.heard_stamp if 0.0 < ahead and (
            self.paused or ahead < EXTRAPOLATED) else self.stamp


def silence(last: Last, now: float, views: int) -> tuple[str, str]:
    """
    Return a name to count by and the reason why no map comes out; ('', '') while one does.

    now [s] is the time of a steady clock, views the number of scans kept so far.
    """
    if last.awaited:
        return 'seconds_without_given_map', last.awaited
    if last.paused:
        return '', ''
    for word, heard in (('scan', last.scan_heard), ('odometry', last.odometry_heard)):
        if now - heard > SILENT:
            age = f'for {now - heard:.0f} s' if heard > float('-inf') else 'yet'
            return f'seconds_without_{word}', f'no {word} {age}'
        if word == 'scan' and last.lacking:
            return 'seconds_without_mount', last.lacking
    if last.step and views:
        return '', ''
    return 'seconds_without_pose', 'no scan could be used yet; the counts of faults say why'


def slam_status(node: str, namespace: str, last: Last, slam: Slam, faults: Mapping[str, int],
                now: float, without_clock: str = '') -> DiagnosticStatus:
    """
    Build the status of a slam_node; now [s] is the time of a steady clock.

    without_clock: why there is no time, '' where there is.
    """
    (scans, since), last.reported = last.reported, (last.scans, now)
    sigma = slam.pose_sigma
    values = {'scans_per_s': (last.scans - scans) / max(now - since, 1e-3),
              'ms_per_scan': 1e3 * last.scan_seconds,
              'age_of_scan_s': now - last.scan_heard,
              'age_of_odometry_s': now - last.odometry_heard,
              'pose_sigma_x_m': sigma[0], 'pose_sigma_y_m': sigma[1],
              'pose_sigma_yaw_rad': sigma[2], **slam.counters.copy(), **faults}
    _, silent = silence(last, now, slam.counters['views'])
    warning = 'paused: new scans are left out' if last.paused else (
        f'{silent}{last.hint}' if silent else without_clock)
    if slam.lost and not warning:
        warning = f'lost: {slam.lost}'
    if last.odometry_late and not warning:
        warning = f'odometry comes {last.odometry_late:.1f} s late, and the pose is as old'
    if (scans_left_out := slam.counters['map_scans_too_far']) and not warning:
        warning = (f'the map is as large as it may be: {scans_left_out} scans are not drawn; a '
                   'coarser resolution reaches farther')
    error = f'the state was not saved: {last.not_saved}' if last.not_saved else ''
    return status(node, namespace, values, warning, error)
