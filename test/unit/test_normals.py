# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Surface normals, point normals (Fig. 4), and their sign."""

from helpers import fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion.normals import free_side, point_normals, surface_normals
from somfusion_ros.geometry import compose, Pose


def chain(count: int) -> np.ndarray:
    """Edges (count - 1, 2) of neurons in a row."""
    return np.column_stack([np.arange(count - 1), np.arange(1, count)])


@settings(max_examples=25, deadline=None)
@given(st.floats(0.0, 6.28), st.integers(2, 12))
def test_normals_of_a_straight_wall_stand_upright(angle: float, count: int) -> None:
    """Surface and point normals are perpendicular to the wall, and the surfaces agree fully."""
    along = np.array([np.cos(angle), np.sin(angle)])
    centres = np.arange(count)[:, None] * 0.4 * along
    surface, length = surface_normals(centres, chain(count))
    point, straight = point_normals(surface, length, chain(count), count)
    assert length == pytest.approx(0.4)
    assert np.abs(surface @ along).max() < 1e-9 and np.abs(point @ along).max() < 1e-9
    assert np.hypot(*point.T) == pytest.approx(1.0) and straight == pytest.approx(1.0)


def test_point_norm_is_the_average_and_ends_take_the_surface() -> None:
    """At a bend of 30 degrees the point normal turns by 15; the ends follow their own surface."""
    turn = np.radians(30.0)
    centres = np.array([(-1.0, 0.0), (0.0, 0.0), (np.cos(turn), np.sin(turn))])
    surface, length = surface_normals(centres, chain(3))
    point, straight = point_normals(surface, length, chain(3), 3)
    angles = np.degrees(np.arctan2(point[:, 1], point[:, 0])) % 180.0
    assert angles == pytest.approx([90.0, 105.0, 120.0])
    assert straight[[0, 2]] == pytest.approx(1.0) and straight[1] < 1.0


def test_a_lonely_neuron_has_no_norm() -> None:
    """Without a surface the normal is zero and nothing is claimed."""
    none = np.empty((0, 2), np.intp)
    surface, length = surface_normals(np.zeros((1, 2)), none)
    point, straight = point_normals(surface, length, none, 1)
    assert not point.any() and not straight.any()


@settings(max_examples=20, deadline=None)
@given(st.floats(-3.1, 3.1), st.sampled_from([0.02, 0.05, 0.1]), st.booleans())
def test_normals_point_to_the_free_side(theta: float, resolution: float, turned: bool) -> None:
    """At the left wall of a room the normal points right, whatever it was and wherever it lies."""
    T = Pose(3.0, -2.0, theta)
    grid = fake_grid(fake_room(), resolution, T)
    spot = compose(T, (resolution / 2, 2.0, 0.0))[None, :2]
    normal = np.array([[np.cos(theta), np.sin(theta)]])
    found, sided = free_side(grid, spot, -normal if turned else normal)
    assert found == pytest.approx(normal) and sided[0] > 0.8


def test_a_wall_free_on_both_sides_is_unsure() -> None:
    """The pillar-thin partition of the room does not know its sign."""
    grid = fake_grid(fake_room())
    _, sided = free_side(grid, np.array([[0.4 * 8.0, 0.8 * 6.0]]), np.array([[1.0, 0.0]]))
    assert sided[0] < 0.2


def test_outside_the_grid_nothing_is_known() -> None:
    """A point far outside has no side."""
    _, sided = free_side(fake_grid(fake_room()), np.array([[99.0, 99.0]]), np.array([[1.0, 0.0]]))
    assert sided[0] == 0.0
