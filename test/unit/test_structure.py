# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Walls against furniture, open space, mirror images, and where to look when two poses fit."""

from types import SimpleNamespace

from helpers import fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.fusion import rasters
from somfusion_ros.fusion.alignment import Alignment
from somfusion_ros.fusion.deformation import bend
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.lookout import LOOKOUT, lookout
from somfusion_ros.fusion.measures import measure
from somfusion_ros.fusion.mirror import mirror
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.snapshot import Snapshot

HERE = np.zeros((1, 3))


def hall(*boxes: tuple[float, float, float, float], theta: float = 0.0) -> LearnedMap:
    """Learn a room of 12 x 8 m with boxes (x0, y0, x1, y1) in it."""
    walls = [fake_room(12.0, 8.0)]
    for x0, y0, x1, y1 in boxes:
        walls.append(np.array([(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1),
                               (x0, y1, x0, y0)], dtype=float))
    return learn(fake_grid(np.concatenate(walls), 0.05, Pose(0.0, 0.0, theta)))


@pytest.mark.parametrize('theta', [0.0, 0.4, 1.2])
def test_long_walls_are_structure_and_furniture_is_not(theta: float) -> None:
    """A wall of 12 m counts fully, the sides of a box of 0.6 m do not count, in any direction."""
    found = hall((1.0, 1.5, 1.6, 2.1), theta=theta)
    c, s = np.cos(theta), np.sin(theta)
    x, y = (found.features.centres @ np.array([[c, -s], [s, c]])).T     # in the hall's frame
    along = (y < 0.2) & (x > 2.0) & (x < 10.0)
    box = (x > 0.8) & (x < 1.8) & (y > 1.3) & (y < 2.3)
    assert along.sum() > 10 and box.any()
    assert found.structure[along].min() > 0.9
    assert found.structure[box].max() < 0.1


def test_clearance_is_the_distance_to_what_is_not_free() -> None:
    """In the middle of a strip of free cells 2 m wide it is one metre, beside it none."""
    image = np.zeros((80, 80), np.float32)
    image[20:60] = 1.0
    raster = rasters.clearance(rasters.zones(Grid(image, 0.05), np.empty((0, 2), np.intp), 0.1))
    spots = np.array([[2.0, 2.0], [2.0, 1.5], [2.0, 0.5]], np.float32).T
    assert raster.at(spots) * rasters.CLEARANCE_STEP == pytest.approx([1.0, 0.5, 0.0], abs=0.1)


def test_a_wall_in_the_open_is_a_contradiction_and_a_box_is_not() -> None:
    """A wall of 5 m across the free space of the other map is seen in full, a chair is not."""
    bare = hall()
    walled, = measure(HERE, bare, hall((5.5, 1.0, 10.5, 1.05)))
    boxed, = measure(HERE, bare, hall((5.5, 1.0, 6.0, 1.5)))
    assert walled.solid_against > 2.0 > 0.2 > boxed.solid_against
    assert boxed.solid == pytest.approx(walled.solid, rel=0.15)


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-9.0, 9.0), st.floats(-9.0, 9.0))
def test_a_mirror_image_is_that_of_the_mirrored_grid(theta: float, x: float, y: float) -> None:
    """Every raster and cluster says of a mirrored place what the map says of the place."""
    one = learn(fake_grid(fake_room(), 0.05, Pose(x, y, theta)))
    image = mirror(one)
    spots = one.features.centres.T.astype(np.float32)
    there = spots * np.float32([[-1.0], [1.0]])
    for name in ('likelihood', 'clearance', 'zones'):
        before, after = (getattr(item, name) for item in (one, image))
        same = before.at(spots) == after.at(there)     # but for places on the edge of a cell
        assert same.mean() > 0.94, name
    twice = mirror(image)
    assert twice.histogram == pytest.approx(one.histogram)
    exact, = measure(HERE, one, twice)
    assert exact.ratio > 0.95


@pytest.mark.parametrize('scale', [0.97, 1.02])
def test_a_bend_finds_the_scale(scale: float) -> None:
    """The walls of a map drawn larger come to lie on one another, and the scale is told."""
    grid = fake_grid(fake_room(14.0, 9.0))
    larger = Grid(grid.evidence, grid.resolution * scale,
                  Pose(*(scale * grid.T_frame_grid[k] for k in (0, 1)), 0.0))
    target, source = learn(grid), learn(larger)
    middle = (1.0 - scale) * np.array([7.0, 4.5])
    found = bend(np.array([*middle, 0.0]), target, source)
    assert found.scale == pytest.approx(1.0 / scale - 1.0, abs=0.006)
    rigid, = measure(np.array([[*middle, 0.0]]), target, source)
    bent, = measure(np.array([[*middle, 0.0]]), target, source, found.warp)
    assert bent.fine_ratio > max(0.85, rigid.fine_ratio)
    assert found.pose == pytest.approx([*middle, 0.0], abs=0.05)


def test_a_lookout_faces_what_tells_two_poses_apart() -> None:
    """Two poses differ in a room beyond the target's edge: the place lies there, facing it."""
    walls = fake_room(12.0, 8.0)
    whole = fake_grid(walls)
    seen = whole.evidence.copy()
    seen[:, 160:] = 0.0                      # the target knows the left 7 m
    target, source = learn(Grid(seen, 0.05, whole.T_frame_grid)), learn(whole)
    place = lookout(target, source, np.zeros(3), np.array([2.0, 0.0, 0.0]))
    assert place is not None and 3.0 < place.x < 7.0 and 0.0 < place.y < 8.0
    assert np.cos(place.theta) > 0.5
    assert lookout(target, source, np.zeros(3), np.zeros(3)) is None


def test_a_lookout_of_a_large_map_looks_as_far_as_it_counted() -> None:
    """Its steps are longer, and as many as are nearest to the sight go farther than that."""
    step = np.sqrt(130.0 ** 2 / LOOKOUT.places)
    spot = np.full((2, 1), 220.0 * step)      # the only free place

    def differing(points: Array) -> Array:
        away = np.hypot(*(points - spot))
        return np.where((away > LOOKOUT.sight) & (away < 15.0 * step), np.uint8(2), np.uint8(0))
    target = SimpleNamespace(cells=np.array([[4.0, 4.0], [126.0, 126.0]]), zones=SimpleNamespace(
        at=lambda points: np.where(np.hypot(*(points - spot)) < 0.1, np.uint8(2), np.uint8(0))))
    source = SimpleNamespace(zones=SimpleNamespace(at=lambda points: np.where(
        points[0] > 500.0, np.uint8(4), differing(points))))
    place = lookout(target, source, np.zeros(3), np.array([-1000.0, 0.0, 0.0]))
    assert place is not None and np.isfinite(place).all()


def test_every_robot_is_told_the_places_in_its_own_map() -> None:
    """The map of the first name is the target: each robot gets the pose in its own frame."""
    here, there = Pose(1.0, 2.0, 0.0), Pose(-3.0, 0.5, 1.0)
    verdict = Alignment(accepted=False, probability=0.4, reason='ambiguous: ...',
                        lookout_target=here, lookout_source=there)
    assert Snapshot(verdicts={'robot2': verdict}).lookouts('robot1') == [here]
    assert Snapshot(verdicts={'robot1': verdict}).lookouts('robot2') == [there]
