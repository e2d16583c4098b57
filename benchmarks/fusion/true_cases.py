# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Makers of true pairs of maps, and of the shared pairs of mesh maps and of storeys."""

from benchmarks.data import drawings, renovations, worlds
from benchmarks.data.real_maps import RealMaps
from benchmarks.fusion.cases import Case, kind, Random
from benchmarks.scores.teams import known_overlap
import numpy as np
from somfusion_ros.geometry import apply, Array
from somfusion_ros.grid import Grid

RENOVATED = 0.02    # m/m2 of wall that is put in or taken out in years, at most


@kind(80)
def true(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a real pair as it is."""
    return Case(*maps.true_pair(number)) if number < maps.true_pairs else None


@kind(400)
def furnished(maps: RealMaps, rng: Random, number: int) -> Case:
    """Move the furniture of both maps."""
    place, *grids, truth, spot = maps.true_pair(number)
    boxes = int(rng.integers(5, 40))
    grids = [worlds.furnished(grid, rng, boxes) for grid in grids]
    return Case(place, grids[0], worlds.worn(grids[1], rng), truth, spot)


@kind(420)
def worn(maps: RealMaps, rng: Random, number: int) -> Case:
    """Lose walls, shake them by a cell, and add noise."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.worn(grid, rng, 1.0, 0.3, 0.002) for grid in grids), truth, spot)


@kind(300)
def redrawn(maps: RealMaps, rng: Random, number: int) -> Case:
    """Mix resolutions."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.redrawn(grid, rng.choice([0.02, 0.03, 0.05, 0.06, 0.08, 0.1]))
                         for grid in grids), truth, spot)


@kind(400)
def drawn_otherwise(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw the two maps as other SLAMs and cheap lidars do."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.drawn_as(grid, rng, int(rng.integers(3))) for grid in grids),
                truth, spot)


@kind(500)
def bent(maps: RealMaps, rng: Random, number: int) -> Case:
    """Bend one of the maps by up to nine degrees."""
    place, target, source, truth, spot = maps.true_pair(number)
    return Case(place, target, *_bent(source, truth, spot, rng.uniform(1.0, 9.0), rng))


@kind(310)
def closed_doors(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Close doors in one of the maps: what lies behind was not seen."""
    place, *grids, truth, _ = maps.true_pair(number)
    side = int(rng.integers(2))
    grids[side] = renovations.closed_doors(grids[side], rng, rng.uniform(0.2, 1.0))
    overlap, spot = known_overlap(*grids, truth)
    if overlap < 0.15 or grids[side].free.sum() * grids[side].resolution ** 2 < 20.0:
        return None
    grids[side] = worlds.furnished(grids[side], rng, int(rng.integers(10)))
    return Case(place, grids[0], worlds.worn(grids[1], rng), truth, np.array(spot))


@kind(850)
def parts(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Cut a map in two that share a strip, half of them bent."""
    place, grid = maps.any_map(rng)
    target, source = worlds.halves(grid, rng.uniform(2.0, 12.0), rng)
    both = target.free & source.free
    if both.sum() * grid.resolution ** 2 < 4.0:
        return None
    spot = grid.points(both).mean(0)
    if rng.random() < 0.5:
        return Case({place}, target, *_bent(source, np.zeros(3), spot, rng.uniform(0, 5), rng))
    return Case({place}, target, worlds.worn(source, rng, 1.0), np.zeros(3), spot)


@kind(1050)
def corridor(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see a corridor's two ends and the middle."""
    width, length = rng.uniform(1.5, 3.0), rng.uniform(10.0, 80.0)
    grid = drawings.corridor(rng, width, length, number % 3)
    unseen = rng.uniform(0.1, 0.35) * length
    target = worlds.worn(worlds.cut(grid, 0.0, 1.0 + length - unseen), rng)
    source = worlds.cut(grid, 1.0 + unseen, 2.0 + length)
    truth, spot = np.zeros(3), np.array([1.0 + length / 2.0, 6.0 + width / 2.0])
    if rng.random() < 0.4:
        return Case({f'corridor {number % 5}'}, target,
                    *_bent(source, truth, spot, rng.uniform(0, 4), rng))
    return Case({f'corridor {number % 5}'}, target, worlds.worn(source, rng), truth, spot)


@kind(620)
def office(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see overlapping parts of an office of equal rooms."""
    rooms = int(rng.integers(5, 10))
    grid, width = drawings.office(rng, rng, rooms)
    spot = np.array([1.0 + rooms * width / 2.0, grid.shape[0] * grid.resolution / 2.0])
    return Case({f'office {number % 5}'},
                worlds.worn(worlds.cut(grid, 0.0, 1.0 + 0.7 * rooms * width), rng),
                worlds.worn(worlds.cut(grid, 1.0 + 0.3 * rooms * width, 999.0), rng),
                np.zeros(3), spot)


@kind(840)
def building(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see overlapping parts of a building of different rooms."""
    width = rng.uniform(7.0, 30.0)
    grid, unseen = drawings.building(rng, width, width * rng.uniform(0.5, 0.9)), 0.0
    if rng.random() < 0.7:
        unseen = width * rng.uniform(0.15, 0.5)
    source = worlds.furnished(worlds.cut(grid, 1.0 + unseen, 999.0), rng, int(rng.integers(6)))
    return Case({f'building {number % 5}'},
                worlds.worn(worlds.cut(grid, 0.0, 1.0 + width - unseen), rng),
                worlds.worn(source, rng), np.zeros(3),
                np.array([1.0 + width / 2.0, grid.shape[0] * grid.resolution / 2.0]))


@kind(20)
def team(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take two robots' maps of one place, each with its own drift."""
    if number >= len(maps.teams):
        return None
    (place, target, source, truth, spot) = maps.teams[number]
    return Case(place, target, source, truth, spot, (2.0, np.radians(9.0)))


@kind(25)
def mesh(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a pair of maps from a depth camera's mesh, aligned by hand, as it is."""
    return _given(maps, 'pairs_mesh', number)


@kind(24)
def floors(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a pair of storeys, wings or years of one building as it is."""
    return _given(maps, 'pairs_floors', number)


def _given(maps: RealMaps, folder: str, number: int) -> Case | None:
    """Take a pair of a folder beside the first as it is."""
    rows = maps.other(folder)
    if number >= len(rows):
        return None
    row, target, source = rows[number]
    places = {'gdc'} if folder == 'pairs_floors' else {row['place_target']}
    if row['kind'] != 'pos':
        return Case(places, target, source)
    truth, spot = (np.array([float(row[name]) for name in names])
                   for names in (('x', 'y', 'theta'), ('centre_x', 'centre_y')))
    return Case(places, target, source, truth, spot)


@kind(420)
def mesh_like(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw a pair as from two depth cameras: bent, of another scale, without clutter."""
    place, target, source, truth, spot = maps.true_pair(number)
    source, truth, spot, (near, _) = _bent(source, truth, spot, rng.uniform(0.0, 4.0), rng)
    factor = rng.uniform(0.97, 1.03)
    source = worlds.meshed(worlds.scaled(source, factor), rng)
    new = spot * factor
    truth = _about(truth, spot, new)
    return Case(place, worlds.meshed(target, rng), source, truth, new, (near, np.radians(6.0)))


@kind(590)
def years(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Map a place again years later: furniture, some partitions, a bend, a little scale."""
    place, target, source, truth, spot = maps.true_pair(number)
    area = int(source.free.sum() * source.resolution ** 2)
    full = min(area, 1000)     # a hall is not full of furniture
    target = renovations.emptied(target, rng, 1.5, rng.uniform(0.2, 1.0))
    source = renovations.emptied(source, rng, 1.5, rng.uniform(0.2, 1.0))
    source = worlds.furnished(source, rng, int(full * rng.uniform(0.02, 0.12)))
    target = worlds.furnished(target, rng, int(full * rng.uniform(0.0, 0.08)))
    parts = int(rng.poisson(0.5 * area * rng.uniform(0.0, RENOVATED)))
    before, source = source, renovations.partitioned(source, rng, parts, 4.0)
    if renovations.changed(before, source)[0] > 1.0 + RENOVATED * area:
        return None
    source, truth, spot, _ = _bent(source, truth, spot, rng.uniform(0.0, 2.0), rng)
    factor = rng.uniform(0.99, 1.01)
    source, new = worlds.scaled(source, factor), spot * factor
    truth = _about(truth, spot, new)
    return Case(place, target, source, truth, new, (0.8, np.radians(4.0)))


def _about(truth: Array, spot: Array, new: Array) -> Array:
    """Move a truth (3,) that takes a spot where it did so that it takes the new spot there."""
    shift = apply(truth, spot[None])[0] - apply((0.0, 0.0, truth[2]), new[None])[0]
    return np.array([*shift, truth[2]])


def _bent(source: Grid, truth: Array, spot: Array, degrees: float,
          rng: Random) -> tuple[Grid, Array, Array, tuple[float, float]]:
    """Bend and wear a source map: the map, and truth, spot and tolerance of its case."""
    grid, move = worlds.bend(source, degrees, rng)
    ends = move(np.array([spot, spot + (0.5, 0.0)]))
    turn = truth[2] - np.arctan2(*(ends[1] - ends[0])[::-1])
    shift = apply(truth, spot[None])[0] - apply((0.0, 0.0, turn), ends[:1])[0]
    return (worlds.worn(grid, rng, 1.0), np.array([*shift, turn]), ends[0],
            (1.2, np.radians(degrees + 2.0)))
