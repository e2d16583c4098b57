# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Histogram, circular cross-correlation, Radon tuning, four-fold hypotheses."""

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion import orientation
from somfusion_ros.geometry import rotation, wrap


def blob(seed: int) -> np.ndarray:
    """Draw normals (N, 2) around three directions that no turn repeats."""
    rng = np.random.default_rng(seed)
    angles = np.concatenate([rng.normal(mean, 0.03, count)
                             for mean, count in ((0.3, 60), (1.6, 40), (3.9, 25))])
    return np.column_stack([np.cos(angles), np.sin(angles)])


def counted(normals: np.ndarray, sided: float = 1.0) -> np.ndarray:
    """Histogram with equal weights."""
    return orientation.histogram(normals, np.ones(len(normals)), np.full(len(normals), sided))


def walls(theta: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 2) every 0.1 m on the walls of an L-shaped room, turned; their weights."""
    lines = [((0, 0), (8, 0)), ((8, 0), (8, 3)), ((8, 3), (5, 3)), ((5, 3), (5, 6)),
             ((5, 6), (0, 6)), ((0, 6), (0, 0))]
    points = np.concatenate([np.linspace(a, b, int(10 * np.hypot(*np.subtract(b, a))), False)
                             for a, b in lines])
    return points @ rotation(theta).T, np.ones(len(points))


def test_histogram_counts_everything_once() -> None:
    """The sum is the sum of the weights, and the peak lies at the normals' direction."""
    normals = np.tile([[np.cos(0.5), np.sin(0.5)]], (10, 1))
    counts = counted(normals)
    assert counts.shape == (360,) and counts.sum() == pytest.approx(10.0)
    assert abs(counts.argmax() - np.degrees(0.5)) <= 1.0


def test_unsure_normals_count_on_both_sides() -> None:
    """Without a free side a normal is worth half at its angle and half at the opposite."""
    counts = counted(np.array([[1.0, 0.0]]), sided=0.0)
    assert counts[0] == pytest.approx(counts[180])


@settings(max_examples=30, deadline=None)
@given(st.floats(-3.14, 3.14), st.integers(0, 100))
def test_correlation_finds_the_turn(theta: float, seed: int) -> None:
    """The best peak is the turn between two maps of the same normals, within one degree."""
    source = blob(seed)
    found = orientation.peaks(orientation.correlate(counted(source @ rotation(theta).T),
                                                    counted(source)), 1)
    assert abs(wrap(found[0] - theta)) < np.radians(1.0)


def test_correlation_is_the_definition() -> None:
    """[k] is the sum over i of target[i + k] source[i], centred and scaled to 1."""
    rng = np.random.default_rng(0)
    a, b = rng.random(360), rng.random(360)
    ca, cb = a - a.mean(), b - b.mean()
    expected = [np.roll(ca, -k) @ cb for k in range(360)]
    expected = np.array(expected) / np.linalg.norm(ca) / np.linalg.norm(cb)
    assert orientation.correlate(a, b) == pytest.approx(expected)
    assert orientation.correlate(a, a)[0] == pytest.approx(1.0)


def test_peaks_are_apart_and_best_first() -> None:
    """Peaks keep their distance, also across 0 degrees."""
    curve = np.zeros(360)
    curve[[359, 2, 90, 200]] = (5.0, 4.0, 3.0, 2.5)
    assert np.degrees(orientation.peaks(curve, 4)) % 360 == pytest.approx([359.0, 90.0, 200.0])


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.14, 3.14), st.floats(-2.5, 2.5))
def test_radon_tuning_is_finer_than_the_histogram(theta: float, error: float) -> None:
    """From 2.5 degrees off, the tuning ends within 0.3 degrees of the turn."""
    target, source = (orientation.spectrum(orientation.radon(*walls(t), orientation.directions(),
                                                             0.1)) for t in (theta, 0.0))
    tuned = orientation.tune(np.array([theta + np.radians(error)]), target, source)
    assert abs(wrap(tuned[0] - theta)) < np.radians(0.3)


def test_radon_of_a_wall_peaks_edge_on() -> None:
    """A wall along x falls into one offset when projected on y, and into many on x."""
    points = np.column_stack([np.arange(0, 5, 0.1), np.zeros(50)])
    directions = np.radians([0.0, 90.0])
    image = orientation.radon(points, np.ones(50), directions, 0.1)
    assert image.sum(1) == pytest.approx(50.0)
    side_by_side = image[:, :-1] + image[:, 1:]
    assert side_by_side[1].max() == pytest.approx(50.0) and side_by_side[0].max() < 5.0
    assert orientation.spectrum(image)[1] > 10 * orientation.spectrum(image)[0]


def test_families_merge_four_fold_companions() -> None:
    """Peaks a quarter turn apart are one family of four; others stay."""
    found = orientation.families(np.radians([10.0, 100.5, 190.0, 40.0]))
    assert np.degrees(found) == pytest.approx([10.0, 40.0])


def test_no_normals_at_all() -> None:
    """Nothing to count still gives curves without NaN."""
    none = counted(np.empty((0, 2)))
    curve = orientation.correlate(none, none)
    assert np.isfinite(curve).all() and len(orientation.peaks(curve, 3)) >= 1


@given(st.integers(0, 2 ** 32 - 1))
def test_more_orientations_begin_with_the_fewer(seed: int) -> None:
    """A wider search settles only the seeds that the first one did not."""
    correlation = np.random.default_rng(seed).normal(size=360)
    correlation = correlation + np.roll(correlation, 1) + np.roll(correlation, 2)
    few, many = (orientation.families(orientation.peaks(correlation, count))
                 for count in (4, 8))
    assert many[:len(few)] == pytest.approx(few)
