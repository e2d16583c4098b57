# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Views turn verdicts that grids leave open, and no others."""

from dataclasses import replace

from hypothesis import given, strategies as st
import pytest
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.geometry import Pose
from somfusion_ros.team.bond import Bond
from somfusion_ros.team.confirming import Confirmation
from somfusion_ros.team.view_verdict import could_matter, judge_views, log_odds

OPEN = Alignment(accepted=False, probability=0.6, reason='refused: walls agree 80 %',
                 T_target_source=Pose(1.0, 2.0, 0.1))


def bond(confirmed: int, asked: int, weakest: float = 0.02) -> Bond:
    """Say what some views say."""
    nan = float('nan')
    return Bond('robot1', 'robot2', (), Confirmation(asked, confirmed), weakest, 0.0, nan, nan,
                True, f'{confirmed} of {asked} views confirm')


def test_views_that_confirm_decide_what_grids_left_open() -> None:
    found = judge_views(OPEN, bond(17, 18), None, 0.8)
    assert found.accepted
    assert found.probability > 0.95
    assert found.reason == 'accepted: 17 of 18 views confirm; walls agree 80 %'
    assert found.T_target_source == OPEN.T_target_source


def test_an_accepted_pose_that_no_view_confirms_is_refused() -> None:
    accepted = replace(OPEN, accepted=True, probability=0.95, reason='accepted: walls agree 90 %')
    found = judge_views(accepted, bond(3, 20), None, 0.8)
    assert not found.accepted
    assert found.reason.startswith('refused: 3 of 20 views confirm')


def test_few_views_and_a_corridor_decide_nothing() -> None:
    assert not judge_views(OPEN, bond(3, 3), None, 0.8).accepted
    assert not judge_views(OPEN, bond(20, 20, weakest=0.5), None, 0.8).accepted
    assert judge_views(OPEN, bond(0, 0), None, 0.8) is OPEN


def test_a_rival_that_views_confirm_as_well_keeps_the_verdict_open() -> None:
    assert not judge_views(OPEN, bond(20, 22), bond(19, 22), 0.8).accepted
    assert judge_views(OPEN, bond(20, 22), bond(6, 22), 0.8).accepted


def test_what_the_grids_exclude_no_view_brings_back() -> None:
    """Strangers are not even asked."""
    assert not could_matter(1e-5, 0.8)
    assert not judge_views(replace(OPEN, probability=1e-5), bond(90, 90), None, 0.8).accepted
    assert could_matter(0.05, 0.8)


@given(asked=st.integers(1, 200), share=st.floats(0.0, 1.0))
def test_more_that_confirm_never_speak_against(asked: int, share: float) -> None:
    confirmed = int(share * asked)
    more = log_odds(bond(min(confirmed + 1, asked), asked))
    assert more >= log_odds(bond(confirmed, asked))


@pytest.mark.parametrize(('confirmed', 'asked'), [(30, 40), (14, 28)])
def test_shares_between_say_little(confirmed: int, asked: int) -> None:
    assert abs(log_odds(bond(confirmed, asked))) < 3.7
