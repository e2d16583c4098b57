# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A rival that fits better over less wall makes a hypothesis ambiguous; one by chance does not."""

from dataclasses import replace

import numpy as np
import pytest
from somfusion_ros.fusion.measures import Evidence
from somfusion_ros.fusion.verdict import CLEAR, margins_over, probability

LARGE = Evidence(matched=60.0, against=1.0, fine=50.0, fine_against=6.0, overlap=0.6, weak=10.0,
                 weak_against=0.5, V=0.99, axis=np.array([1.0, 0.0]), solid=30.0, common=100.0)


@pytest.mark.parametrize('fine, ambiguous', [(29.0, True), (15.0, False)])
def test_a_close_rival_is_compared_however_little_wall_it_matches(
        fine: float, ambiguous: bool) -> None:
    """Over 29 m to a cell it scores 0.92 of the best, over 15 m 0.65: then it is chance."""
    rival = replace(LARGE, fine=fine, fine_against=0.1)
    margins = margins_over(LARGE, [rival])
    assert probability(LARGE, CLEAR) > 0.9
    assert (margins.odds < 1.0) == ambiguous
    assert (probability(LARGE, margins) < 0.1) == ambiguous
