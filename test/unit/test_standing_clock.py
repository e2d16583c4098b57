# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A clock that stands still, and what only looks like one."""

from drives import Counts
import numpy as np
import pytest
from somfusion_ros.slam.standing_clock import StandingClock


def mended(told: list[tuple[float, float, float]]) -> tuple[list[float], Counts]:
    """Mend messages of (stamp, content, now); return their stamps, and what was counted."""
    counts = Counts()
    clock = StandingClock('scan', counts)
    return [clock.mend(stamp, np.array([content]), now) for stamp, content, now in told], counts


@pytest.mark.parametrize('goes_on', [False, True])
def test_messages_of_a_clock_that_stands_are_stamped_by_when_they_come(goes_on: bool) -> None:
    before = [(5.0 + 0.1 * k, k, 0.1 * k) for k in range(10)]
    still = [(5.9, k, 0.1 * k) for k in range(10, 30)]
    after = [(5.0 + 0.1 * k - 2.0 * goes_on, k, 0.1 * k) for k in range(30, 40)]
    stamps, counts = mended(before + still + after)
    assert stamps[12:] == pytest.approx([5.0 + 0.1 * k for k in range(12, 40)])
    assert counts == {'scan_clock_stood': 1}


@pytest.mark.parametrize('told', [
    pytest.param([(5.0, 1.0, 0.1 * k) for k in range(50)], id='one message told again'),
    pytest.param([(5.0, k, 3.0) for k in range(50)], id='held, and stamped on arrival'),
    pytest.param([(5.0 + k // 2, k, 0.5 * k) for k in range(50)], id='two of every stamp'),
    pytest.param([(5.0 + 0.1 * (k < 20) * k, k, 0.0) for k in range(50)], id='a log')])
def test_what_only_looks_like_a_clock_that_stands_is_left_alone(
        told: list[tuple[float, float, float]]) -> None:
    stamps, counts = mended(told)
    assert stamps == [stamp for stamp, _, _ in told]
    assert not counts
