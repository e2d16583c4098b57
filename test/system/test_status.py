# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What slam_node's diagnostics say, and how loudly."""

from collections import Counter
from types import SimpleNamespace

from helpers import need_ros
import pytest

need_ros()
from diagnostic_msgs.msg import DiagnosticStatus  # noqa: E402, I100
from somfusion_ros.ros.slam.status import Last, slam_status  # noqa: E402


@pytest.mark.parametrize('lost, not_saved, left_out, level, words', [
    ('', '', 0, DiagnosticStatus.OK, ''),
    ('no place fits', '', 0, DiagnosticStatus.WARN, 'lost: no place fits'),
    ('', '', 7, DiagnosticStatus.WARN, '7 scans are not drawn'),
    ('', 'no space left', 0, DiagnosticStatus.ERROR, 'the state was not saved: no space left'),
    ('no place fits', 'no space left', 7, DiagnosticStatus.ERROR, 'no space left')])
def test_what_goes_wrong_is_no_counter_beside_ok(lost: str, not_saved: str, left_out: int,
                                                 level: bytes, words: str) -> None:
    slam = SimpleNamespace(pose_sigma=(0.1, 0.1, 0.1), lost=lost,
                           counters=Counter(views=3, map_scans_too_far=left_out))
    last = Last(step=SimpleNamespace(), scan_heard=99.9, odometry_heard=99.9, not_saved=not_saved)
    told = slam_status('slam_node', '/robot1', last, slam, {}, 100.0)
    assert told.level == level and words in told.message


def test_odometry_that_comes_late_is_a_warning() -> None:
    last = Last(step=SimpleNamespace(), scan_heard=99.9, odometry_heard=99.9, odometry_late=2.5)
    slam = SimpleNamespace(pose_sigma=(0.1, 0.1, 0.1), lost='', counters=Counter(views=3))
    told = slam_status('slam_node', '/robot1', last, slam, {}, 100.0)
    assert told.level == DiagnosticStatus.WARN
    assert told.message == 'odometry comes 2.5 s late, and the pose is as old'
