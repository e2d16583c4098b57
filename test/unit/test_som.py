# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clusters: where they lie, how many there are, what they are joined to."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.som import presentations, train


def wall(length: float, step: float = 0.05) -> np.ndarray:
    """Cell centres (N, 2) [m] along x."""
    x = np.arange(0.0, length, step) + step / 2
    return np.column_stack([x, np.zeros_like(x)])


def learn(points: np.ndarray, spacing: float = 0.4, segments: np.ndarray | None = None,
          times: np.ndarray | None = None) -> tuple:
    """Train with everything presented once, in one segment."""
    segments = np.zeros(len(points), np.intp) if segments is None else segments
    return train(points, np.ones(len(points)) if times is None else times, segments, spacing)


def test_presentations_follow_certainty() -> None:
    """A cell is presented round(|C| / delta) times (4), at least once."""
    evidence = np.array([-1.0, -0.52, -0.31, -0.01])
    assert presentations(evidence, 0.1).tolist() == [10, 5, 3, 1]


@settings(max_examples=25, deadline=None)
@given(length=st.floats(1.0, 30.0), spacing=st.sampled_from([0.2, 0.4, 1.0]))
def test_number_of_neurons_follows_the_length(length: float, spacing: float) -> None:
    """A wall gets about length / spacing neurons, in one chain."""
    centres, of, edges, winner = learn(wall(length), spacing)
    assert abs(len(centres) - length / spacing) <= 2
    assert len(edges) == len(centres) - 1, 'a wall is one chain'
    order = np.argsort(centres[:, 0])
    chain = np.sort(order[np.column_stack([np.arange(len(order) - 1),
                                           np.arange(1, len(order))])], axis=1)
    assert {tuple(e) for e in edges} == {tuple(e) for e in chain}
    assert (of == 0).all() and len(winner) == len(wall(length))


@settings(max_examples=20, deadline=None)
@given(angle=st.floats(0.0, 6.28), seed=st.integers(0, 10 ** 6))
def test_clusters_lie_on_the_wall(angle: float, seed: int) -> None:
    """Clusters of a noisy wall lie nearer to it than its cells do: within 0.02 m of 0.03."""
    rng = np.random.default_rng(seed)
    c, s = np.cos(angle), np.sin(angle)
    straight = np.repeat(wall(10.0), 3, axis=0)
    points = (straight + rng.normal(0, (0.0, 0.03), straight.shape)) @ [[c, s], [-s, c]]
    centres = learn(points)[0]
    off = centres @ (-s, c)
    assert np.sqrt((off ** 2).mean()) < 0.02


def test_fixed_point_is_the_weighted_mean_of_what_is_won() -> None:
    """After the last pass a neuron is the mean of its cells, weighted by presentations."""
    rng = np.random.default_rng(3)
    points, times = rng.uniform(0, 3, (400, 2)), rng.integers(1, 11, 400).astype(float)
    centres, _, _, winner = learn(points, 0.5, times=times)
    for k in range(len(centres)):
        mine = winner == k
        assert centres[k] == pytest.approx(np.average(points[mine], axis=0, weights=times[mine]))


def test_certain_cells_pull_more() -> None:
    """The cluster of a sure and an unsure row of cells lies nearer to the sure one."""
    row = wall(0.3)
    points = np.concatenate([row, row + (0, 0.05)])
    times = presentations(np.r_[np.full(len(row), -1.0), np.full(len(row), -0.3)], 0.1)
    centres = learn(points, 0.4, times=times)[0]
    assert centres[:, 1] == pytest.approx(0.05 * 3 / 13, abs=1e-9)


def test_neurons_of_two_segments_are_never_joined() -> None:
    """Two walls 0.2 m apart, each a segment: every neuron belongs to one, no edge crosses."""
    points = np.concatenate([wall(5.0), wall(5.0) + (0, 0.2)])
    segments = np.repeat([0, 1], len(points) // 2)
    centres, of, edges, winner = learn(points, segments=segments)
    assert (of[edges[:, 0]] == of[edges[:, 1]]).all()
    assert (of[winner] == segments).all()
    assert centres[:, 1] == pytest.approx(np.where(of == 1, 0.2, 0.0), abs=1e-9)


@pytest.mark.parametrize('count', [1, 2])
def test_tiny_segments(count: int) -> None:
    """One or two cells make one neuron without edges."""
    centres, of, edges, winner = learn(wall(0.05 * count))
    assert len(centres) == 1 and len(edges) == 0 and len(winner) == count


def test_deterministic() -> None:
    """The same cells give the same clusters."""
    points = np.random.default_rng(5).uniform(0, 5, (300, 2))
    for a, b in zip(learn(points), learn(points), strict=True):
        assert np.array_equal(a, b)
