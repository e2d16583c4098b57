# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""New views of what changed, and the old ones whose place they take."""

from somfusion_ros.slam.successors import Successors, TUNING


def test_a_new_view_takes_the_place_of_old_ones_once_another_pass_confirms_it() -> None:
    successors = Successors()
    successors.add(9, [3, 4], 100.0)
    successors.add(10, [], 101.0)
    assert successors.confirm(8, 300.0) == successors.confirm(10, 300.0) == ()
    assert successors.confirm(9, 100.0 + 0.5 * TUNING.later) == ()     # the same pass
    assert successors.confirm(9, 100.0 + TUNING.later) == (3, 4)
    assert successors.confirm(9, 300.0) == ()                          # once
