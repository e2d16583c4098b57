# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The verdict on a pair in words and numbers, as a panel."""

import textwrap
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.report.pair_data import PairData
from somfusion_ros.report.palette import AGREEMENT, CONFLICT

if TYPE_CHECKING:
    from somfusion_ros.fusion.alignment import Alignment

COLOURS = {'accepted': AGREEMENT, 'ambiguous': '#B8860B', 'refused': CONFLICT}


def verdict_word(found: 'Alignment') -> str:
    """Return the first word of the reason: accepted, ambiguous or refused."""
    return found.reason.partition(':')[0]


def draw_verdict(axes: Axes, data: PairData) -> None:
    """Write the verdict with its numbers, its rival's beside them, and the time it took."""
    found = data.trace.alignment
    axes.axis('off')
    axes.set_title('Verdict')
    word = verdict_word(found)
    axes.text(0.0, 0.96, word.upper(), fontsize=15, fontweight='bold', va='top',
              transform=axes.transAxes, color=COLOURS[word])
    rows = [('probability', f'{found.probability:.3f}', _probability(found)),
            ('x, y [m]', _place(found.T_target_source), _place(data.runner_up)),
            ('theta [deg]', _turn(found.T_target_source), _turn(data.runner_up)),
            ('V [%]', f'{found.verification_index:.1f}', ''),
            ('overlap', f'{found.overlap:.2f}', ''),
            ('seconds', f'{sum(found.seconds.values()):.2f}', '')]
    for column, heading in ((0.30, 'best'), (0.66, 'runner-up')):
        axes.text(column, 0.80, heading, va='top', transform=axes.transAxes, color='#666666')
    for number, row in enumerate(rows):
        for column, text in zip((0.0, 0.30, 0.66), row):
            axes.text(column, 0.72 - 0.075 * number, text, va='top', transform=axes.transAxes)
    axes.text(0.0, 0.24, '\n'.join(textwrap.wrap(found.reason, 52)[:5]), va='top',
              transform=axes.transAxes, color='#333333', style='italic')


def _probability(found: 'Alignment') -> str:
    """Return the probability of the best rival in words."""
    return '-' if found.runner_up is None else f'{found.runner_up.probability:.3f}'


def _place(pose: Pose | None) -> str:
    """Return the position of a pose in words."""
    return '-' if pose is None else f'{pose.x:.2f}, {pose.y:.2f}'


def _turn(pose: Pose | None) -> str:
    """Return the heading of a pose in words."""
    return '-' if pose is None else f'{np.degrees(pose.theta):.1f}'
