# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How old views are when the global map shows them first."""

import numpy as np
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.view_ages import ViewAges
from somfusion_ros.team.view_set import ViewSet


def views(*stamps: float) -> ViewSet:
    """Make views of nothing at some times [s]."""
    return ViewSet(np.array(stamps), np.zeros((len(stamps), 3)), [], [])


def test_a_view_counts_once_and_those_of_before_one_joined_do_not() -> None:
    heard = {'robot2': Heard()}
    ages = ViewAges(heard)
    ages.note({'robot2': views(1.0, 2.0), 'stranger': views(1.0)}, 100.0)
    assert not heard['robot2'].view_ages      # it joined late: what was before is no measure
    ages.note({'robot2': views(1.0, 2.0, 101.0, 102.0)}, 104.0)
    ages.note({'robot2': views(1.0, 2.0, 101.0, 102.0)}, 109.0)
    assert [*heard['robot2'].view_ages] == [3.0, 2.0]


def test_another_map_begins_anew() -> None:
    heard = {'robot2': Heard()}
    ages = ViewAges(heard)
    ages.note({'robot2': views(1.0, 2.0)}, 3.0)
    ages.note({'robot2': views(50.0, 51.0)}, 60.0)
    assert not heard['robot2'].view_ages
    ages.note({'robot2': views(50.0, 51.0, 60.0)}, 64.0)
    assert [*heard['robot2'].view_ages] == [4.0]
