# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whose map frame `world` is, and that no change of it is silent."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import between, Pose
from somfusion_ros.team.words import ordinal, sentence
from somfusion_ros.team.world import anchor_of, anchored, anchored_covariances, WorldWatch

coordinate = st.floats(-100.0, 100.0)
poses = st.builds(Pose, coordinate, coordinate, st.floats(-3.1, 3.1))
groups = st.dictionaries(st.sampled_from('abcdef'), poses, min_size=1)


@given(groups, st.sampled_from('abcdef'))
def test_an_anchor_moves_world_and_nothing_in_it(group: dict[str, Pose], anchor: str) -> None:
    world = anchored(group, anchor)
    assert world.keys() == group.keys()
    for a in group:
        for b in group:
            assert np.allclose(between(world[a], world[b])[:2], between(group[a], group[b])[:2],
                               atol=1e-9)   # [m]
    if anchor in group:
        assert world[anchor] == pytest.approx(Pose())
        assert anchor_of(group, anchor) == anchor
    else:
        assert world == group
        assert anchor_of(group, anchor) == min(group)


def test_the_anchor_is_certain_and_the_others_as_uncertain_as_it_was() -> None:
    group = {'a': Pose(), 'b': Pose(10.0, 0.0, np.pi / 2), 'c': Pose(10.0, 5.0, 0.0)}
    P = {'a': np.zeros((3, 3)), 'b': np.diag([0.04, 0.01, 1e-4]), 'c': np.diag([0.01, 0.01, 1e-4])}
    unmoved = anchored_covariances(group, P, '')
    assert all(np.array_equal(unmoved[robot], P[robot]) for robot in group)
    moved = anchored_covariances(group, P, 'b')
    assert not moved['b'].any()
    # What b was uncertain of across is along in its frame; 10 m of lever make 0.01 m^2 of 1e-4.
    assert np.diag(moved['a']) == pytest.approx([0.01 + 0.01, 0.04, 1e-4])
    assert np.diag(moved['c']) == pytest.approx([0.02, 0.05 + 25e-4, 2e-4])


def test_every_change_of_world_is_said_and_counted() -> None:
    said: list[str] = []
    watch = WorldWatch('b', 0.2, 0.03, said.append)
    watch.look({'b': Pose()}, 'b')
    assert not said
    for x in np.arange(3.0, 3.19, 0.02):   # accepted, then it moves a little on and on
        watch.look({'a': Pose(), 'b': Pose(x, 0.0, 0.0)}, 'a')
    assert watch.changes == len(said) == 1
    assert 'the map frame of a now' in said[0]
    assert '3.00 m' in said[0]
    watch.look({'a': Pose(), 'b': Pose(3.3, 0.0, 0.0)}, 'a')   # far enough from what was said
    watch.look({'b': Pose()}, 'b')
    assert watch.changes == len(said) == 3


def test_a_large_step_is_said_also_where_it_leads_back() -> None:
    said: list[str] = []
    watch = WorldWatch('b', 0.2, 0.1, said.append)
    for x in (0.1, 0.19, 0.04):    # never 0.2 m from what was said; the last one is one step
        watch.look({'b': Pose(x, 0.0, 0.0)}, 'b')
    assert not said
    watch.look({'b': Pose(0.195, 0.0, 0.0)}, 'b')
    assert len(said) == 1


@pytest.mark.parametrize(('word', 'reason', 'expected'), [
    ('refused', 'refused: the target map shows too little', "refused: a's map shows too little"),
    ('refused', 'ambiguous: two places', 'ambiguous: two places'),
    ('accepted', 'accepted: walls agree', 'accepted: walls agree'),
    ('updated', 'accepted: walls agree', 'updated: walls agree'),
    ('kept', 'refused: walls differ', 'kept, though this time refused: walls differ'),
    ('withdrawn', 'refused: walls differ', 'withdrawn: walls differ')])
def test_verdicts_read_as_sentences(word: str, reason: str, expected: str) -> None:
    assert sentence(word, reason, 'a', 'b') == expected


def test_ordinals() -> None:
    assert [ordinal(n) for n in (1, 2, 3, 4, 11, 12, 21, 102, 113)] == [
        'first', 'second', 'third', '4th', '11th', '12th', '21st', '102nd', '113th']
