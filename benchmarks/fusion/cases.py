# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
True pairs of maps, and pairs of different places, by kind: what a verdict must tell apart.

Every case is made of its kind and number alone, so that any one of them can be made again.
"""

from collections.abc import Callable
from dataclasses import dataclass
from zlib import crc32

from benchmarks.data import worlds
from benchmarks.data.real_maps import RealMaps
import numpy as np
from somfusion_ros.geometry import apply, Array
from somfusion_ros.grid import Grid

Random = np.random.Generator
REAL = ('true', 'team', 'different', 'mesh', 'floors')     # taken as they are, always all
NEAR = (0.5, np.radians(5.0))     # right within these [m, rad]


@dataclass
class Case:
    """Two maps; their places; the truth (3,) or None, the spot (2,) where it counts [m, rad]."""

    places: set[str]
    target: Grid
    source: Grid
    truth: Array | None = None
    spot: Array | None = None
    tolerance: tuple[float, float] = NEAR

    def is_right(self, pose: Array | None) -> bool:
        """Tell whether a pose (3,) is the true one; never for different places."""
        if self.truth is None or pose is None:
            return False
        off = np.subtract(*(apply(T, self.spot[None])[0] for T in (pose, self.truth)))
        turn = abs((pose[2] - self.truth[2] + np.pi) % (2.0 * np.pi) - np.pi)
        return bool(np.hypot(*off) < self.tolerance[0] and turn < self.tolerance[1])


Maker = Callable[[RealMaps, Random, int], Case | None]
KINDS: dict[str, tuple[Maker, int]] = {}     # maker and number of cases of each kind


def kind(count: int) -> Callable[[Maker], Maker]:
    """Register a maker under its name."""
    def register(maker: Maker) -> Maker:
        KINDS[maker.__name__] = maker, count
        return maker
    return register


def make(name: str, maps: RealMaps, number: int) -> Case | None:
    """Make a case; None where the dice gave nothing usable, or there are no such maps."""
    return KINDS[name][0](maps, np.random.default_rng([crc32(name.encode()), number]), number)


@kind(80)
def true(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a real pair as it is."""
    return Case(*maps.true_pair(number)) if number < maps.true_pairs else None


@kind(80)
def furnished(maps: RealMaps, rng: Random, number: int) -> Case:
    """Move the furniture of both maps."""
    place, *grids, truth, spot = maps.true_pair(number)
    boxes = int(rng.integers(5, 40))
    grids = [worlds.furnished(grid, rng, boxes) for grid in grids]
    return Case(place, grids[0], worlds.worn(grids[1], rng), truth, spot)


@kind(80)
def worn(maps: RealMaps, rng: Random, number: int) -> Case:
    """Lose walls, shake them by a cell, and add noise."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.worn(grid, rng, 1.0, 0.3, 0.002) for grid in grids), truth, spot)


@kind(80)
def redrawn(maps: RealMaps, rng: Random, number: int) -> Case:
    """Mix resolutions."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.redrawn(grid, rng.choice([0.05, 0.06, 0.08, 0.1]))
                         for grid in grids), truth, spot)


@kind(120)
def drawn_otherwise(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw the two maps as other SLAMs and cheap lidars do."""
    place, *grids, truth, spot = maps.true_pair(number)
    return Case(place, *(worlds.drawn_as(grid, rng, int(rng.integers(3))) for grid in grids),
                truth, spot)


@kind(160)
def bent(maps: RealMaps, rng: Random, number: int) -> Case:
    """Bend one of the maps by up to nine degrees."""
    place, target, source, truth, spot = maps.true_pair(number)
    return Case(place, target, *_bent(source, truth, spot, rng.uniform(1.0, 9.0), rng))


@kind(250)
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


@kind(250)
def corridor(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see a corridor's two ends and the middle."""
    width, length = rng.uniform(1.5, 3.0), rng.uniform(10.0, 80.0)
    grid, unseen = worlds.corridor(rng, width, length, number % 3), rng.uniform(0.1, 0.35) * length
    target = worlds.worn(worlds.cut(grid, 0.0, 1.0 + length - unseen), rng)
    source = worlds.cut(grid, 1.0 + unseen, 2.0 + length)
    truth, spot = np.zeros(3), np.array([1.0 + length / 2.0, 6.0 + width / 2.0])
    if rng.random() < 0.4:
        return Case({f'corridor {number % 5}'}, target,
                    *_bent(source, truth, spot, rng.uniform(0, 4), rng))
    return Case({f'corridor {number % 5}'}, target, worlds.worn(source, rng), truth, spot)


@kind(150)
def office(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see overlapping parts of an office of equal rooms."""
    rooms = int(rng.integers(5, 10))
    grid, width = worlds.office(rng, rng, rooms)
    spot = np.array([1.0 + rooms * width / 2.0, grid.shape[0] * grid.resolution / 2.0])
    return Case({f'office {number % 5}'},
                worlds.worn(worlds.cut(grid, 0.0, 1.0 + 0.7 * rooms * width), rng),
                worlds.worn(worlds.cut(grid, 1.0 + 0.3 * rooms * width, 999.0), rng),
                np.zeros(3), spot)


@kind(200)
def building(maps: RealMaps, rng: Random, number: int) -> Case:
    """Two robots see overlapping parts of a building of different rooms."""
    width = rng.uniform(7.0, 30.0)
    grid, unseen = worlds.building(rng, width, width * rng.uniform(0.5, 0.9)), 0.0
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


@kind(60)
def different(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a real pair of different places as it is."""
    return Case(*maps.false_pair(number)) if number < maps.false_pairs else None


@kind(1200)
def crossed(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take two maps of different places, some cut or mirrored."""
    (here, target), (there, source) = maps.any_map(rng), maps.any_map(rng)
    if here == there:
        return None
    if rng.random() < 0.4:
        target = worlds.halves(target, rng.uniform(-8.0, 5.0), rng)[rng.integers(2)]
    if rng.random() < 0.4:
        source = worlds.halves(source, rng.uniform(-8.0, 5.0), rng)[rng.integers(2)]
    return Case({here, there}, target, worlds.mirrored(source) if rng.random() < 0.3 else source)


@kind(120)
def mirrored(maps: RealMaps, rng: Random, number: int) -> Case:
    """Take a map and the mirror image of a map of the same place: different places."""
    place, grid, other = maps.same_place(number, rng)
    return Case({place}, grid, worlds.mirrored(other))


@kind(500)
def gap(maps: RealMaps, rng: Random, number: int) -> Case:
    """Take two parts of one building that do not overlap."""
    place, grid = maps.any_map(rng)
    target, source = worlds.halves(grid, -rng.uniform(0.5, 2.0), rng)
    return Case({place}, target, worlds.turned(source, rng))


@kind(900)
def corridors(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two corridors of equal width, 10 to 80 m long, with other doors and crossings."""
    width = rng.uniform(1.5, 3.0)
    target, source = (worlds.worn(worlds.corridor(rng, width, rng.uniform(10, 80), number % 3),
                                  rng) for _ in range(2))
    if rng.random() < 0.3:
        source = worlds.bend(source, rng.uniform(0.5, 4.0), rng)[0]
    return Case({f'corridor {number % 5}'}, target, worlds.turned(source, rng))


@kind(150)
def corridor_in_map(maps: RealMaps, rng: Random, number: int) -> Case:
    """Lay a drawn corridor into a real map."""
    place, grid = maps.any_map(rng)
    other = worlds.corridor(rng, rng.uniform(1.5, 3.0), rng.uniform(10.0, 80.0), number % 3)
    return Case({place}, grid, worlds.turned(worlds.worn(other, rng), rng))


@kind(500)
def offices(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two offices of equal rooms, most with the same layout and other furniture."""
    layouts = rng.integers(10 ** 6, size=2)
    if rng.random() < 0.6:
        layouts[1] = layouts[0]
    target, source = (worlds.worn(worlds.office(rng, np.random.default_rng(layout),
                                                int(rng.integers(4, 10)))[0], rng)
                      for layout in layouts)
    return Case({f'office {number % 5}'}, target, worlds.turned(source, rng))


@kind(500)
def buildings(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two buildings of different rooms."""
    widths = rng.uniform(5.0, 25.0, 2)
    target, source = (worlds.worn(worlds.building(rng, width, width * rng.uniform(0.5, 0.9)), rng)
                      for width in widths)
    return Case({f'building {number % 5}'}, target, worlds.turned(source, rng))


@kind(150)
def storeys(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two storeys of one building: the outer walls and the large areas are the same."""
    width, plan = rng.uniform(10.0, 45.0), int(rng.integers(10 ** 6))
    height = width * rng.uniform(0.5, 0.9)
    planned = width * height * rng.uniform(0.1, 0.6)
    target, source = (worlds.worn(worlds.furnished(
        worlds.building(rng, width, height, np.random.default_rng(plan), planned), rng,
        int(rng.integers(6))), rng) for _ in range(2))
    return Case({f'storey {number % 5}'}, target, worlds.turned(source, rng))


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


@kind(120)
def mesh_like(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw a pair as from two depth cameras: bent, of another scale, without clutter."""
    place, target, source, truth, spot = maps.true_pair(number)
    source, truth, spot, _ = _bent(source, truth, spot, rng.uniform(0.0, 4.0), rng)
    factor = rng.uniform(0.97, 1.03)
    source = worlds.meshed(worlds.scaled(source, factor), rng)
    new = spot * factor
    truth = _about(truth, spot, new)
    return Case(place, worlds.meshed(target, rng), source, truth, new, (0.6, np.radians(6.0)))


@kind(160)
def years(maps: RealMaps, rng: Random, number: int) -> Case:
    """Map a place again years later: furniture, some partitions, a bend, a little scale."""
    place, target, source, truth, spot = maps.true_pair(number)
    area = int(source.free.sum() * source.resolution ** 2)
    target = worlds.emptied(target, rng, 1.5, rng.uniform(0.2, 1.0))
    source = worlds.emptied(source, rng, 1.5, rng.uniform(0.2, 1.0))
    source = worlds.furnished(source, rng, int(area * rng.uniform(0.02, 0.12)))
    target = worlds.furnished(target, rng, int(area * rng.uniform(0.0, 0.08)))
    source = worlds.partitioned(source, rng, int(rng.poisson(area / rng.uniform(120, 600))), 4.0)
    source, truth, spot, _ = _bent(source, truth, spot, rng.uniform(0.0, 2.0), rng)
    factor = rng.uniform(0.99, 1.01)
    source, new = worlds.scaled(source, factor), spot * factor
    truth = _about(truth, spot, new)
    return Case(place, target, source, truth, new, (0.8, np.radians(4.0)))


@kind(500)
def real_storeys(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Draw another storey of a real floor plan: the same shell, other rooms, all else moved."""
    place, grid = maps.any_map(rng)
    area = grid.free.sum() * grid.resolution ** 2
    if area < 40.0:
        return None
    bare = worlds.emptied(grid, rng, 2.5, rng.uniform(0.8, 1.0))
    part, every = rng.uniform(0.2, 0.8), rng.uniform(6.0, 18.0)
    other = worlds.partitioned(bare, rng, int(part * area / every) + 2, 12.0)
    other = worlds.extended(other, rng, int((1.0 - part) * area / every) + 1)
    if rng.random() < 0.5:
        shared, sides = rng.uniform(-4.0, 8.0), rng.integers(2, size=2)
        grid, bare, other = (
            worlds.halves(each, shared, np.random.default_rng(number))[side]
            for each, side in ((grid, sides[0]), (bare, sides[1]), (other, sides[1])))
    # Where little of the change is left in what both show, they are not different places.
    both = (grid.free & other.free).sum() * grid.resolution ** 2
    new = worlds.new_walls(other, grid) + worlds.new_walls(grid, other, bare.occupied)
    if both > 4.0 and new < max(8.0, 0.1 * both):
        return None
    other = worlds.furnished(other, rng, int(area * rng.uniform(0.04, 0.15)))
    if rng.random() < 0.5:
        other = worlds.bend(other, rng.uniform(0.3, 2.0), rng)[0]
    return Case({place}, grid, worlds.turned(worlds.worn(other, rng, 1.0, 0.2), rng))


@kind(400)
def mesh_false(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take mesh maps, drawn and real, of different places, and mesh parts that do not overlap."""
    if rng.random() < 0.4:
        place, grid = maps.mesh_map(rng)
        target, source = worlds.halves(grid, -rng.uniform(0.5, 3.0), rng)
        return Case({place}, target, worlds.turned(source, rng))
    (here, target), (there, source) = (maps.mesh_map(rng) if rng.random() < 0.5 else
                                       maps.any_map(rng) for _ in range(2))
    if here == there:
        return None
    return Case({here, there}, worlds.meshed(target, rng),
                worlds.turned(worlds.meshed(source, rng), rng))


@kind(400)
def wings(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take parts of one storey's plan that do not overlap, or a map of a storey elsewhere."""
    place, grid = maps.floor_map(rng)
    if rng.random() < 0.5:
        target, source = worlds.halves(grid, -rng.uniform(0.5, 3.0), rng)
        return Case({place}, target, worlds.turned(source, rng))
    there, source = maps.mesh_map(rng) if rng.random() < 0.3 else maps.any_map(rng)
    return Case({place, there}, grid, worlds.turned(source, rng))


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
