# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a map keeps a view, and when the robot that makes it is astray."""

from dataclasses import dataclass

from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class ViewTuning:
    """When a view is kept."""

    lost_travel: float = tuned(
        4.0, 'views', "a lost robot keeps matching against its last views for so many views' "
        'travel before it keeps a new one', 'mit-csail')
    blind_due: int = tuned(
        6, 'scans', 'without a match, after which a robot that would keep a view is astray',
        'mit-csail')
    blind: int = tuned(
        15, 'scans', 'without a match, after which any robot is astray', 'by design')
    known: int = tuned(
        15, 'views', 'that make a map worth coming back to', 'by design')


TUNING = ViewTuning()
