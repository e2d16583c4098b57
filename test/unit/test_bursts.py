# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Scans whose computer stalls are stamped in a burst; their odometry may leave out the way."""

from itertools import pairwise

import numpy as np
import pytest
from somfusion_ros.slam.bursts import Bursts

VELOCITY = np.array([0.5, 0.0, 0.2])
STEADY = [0.2 * k for k in range(60)]


def judged(stamps: list[float]) -> list[tuple[float, np.ndarray]]:
    """Judge scans of a robot that drives on."""
    bursts = Bursts()
    return [bursts.judge(b - a, VELOCITY) for a, b in pairwise(stamps)]


@pytest.mark.parametrize('stamps', [
    STEADY,
    [0.02 * k for k in range(60)],
    [0.2 * (k // 2) + 0.002 * (k % 2) for k in range(120)],         # two lasers at once
    [*STEADY, *(t + 15.0 for t in STEADY)],                         # a pause
    np.cumsum(np.random.default_rng(1).uniform(0.4, 6.0, 80)).tolist()])   # a scan per metre
def test_scans_without_a_burst_have_the_motion_that_odometry_tells(stamps: list[float]):
    for (dt, unknown), (a, b) in zip(judged(stamps), pairwise(stamps), strict=True):
        assert dt == max(b - a, 0.05)
        assert not unknown.any()


def test_scans_of_a_burst_are_as_unsure_as_what_is_driven_between_two_usual_ones():
    """A computer stalls for 1 s, and stamps five scans 5 ms apart; sigmas to a third."""
    stalled = [*STEADY, *(STEADY[-1] + 1.0 + 0.005 * k for k in range(5))]
    *_, pause, first, second, _, _, last = judged([*stalled, stalled[-1] + 0.2])
    assert not pause[1].any()
    for dt, unknown in (first, second):
        assert dt == pytest.approx(0.2, rel=0.3)
        sigmas = np.sqrt(np.diag(unknown))
        assert sigmas == pytest.approx(0.2 * VELOCITY + (0.0, 0.01, 0.0), rel=0.3)
    assert not last[1].any()
