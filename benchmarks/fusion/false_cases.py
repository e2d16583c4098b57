# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Makers of pairs of maps of different places."""

from functools import lru_cache

from benchmarks.data import drawings, renovations, worlds
from benchmarks.data.real_maps import RealMaps
from benchmarks.fusion.cases import Case, kind, Random
import numpy as np
from somfusion_ros.grid import Grid

POOL, OF_A_POOL = 24, 200     # maps that are matched with one another, and pairs of them
RENOVATED = 0.07    # m/m2 of wall that differs at least in another storey, as in real ones


@kind(60)
def different(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take a real pair of different places as it is."""
    return Case(*maps.false_pair(number)) if number < maps.false_pairs else None


@kind(6000)
def crossed(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Match maps of different places with one another, drawn in all ways: see _pool."""
    pool = _pool(maps, number // OF_A_POOL)
    pairs = [(i, j) for j in range(POOL) for i in range(j) if pool[i][0] != pool[j][0]]
    order = np.random.default_rng(number // OF_A_POOL).permutation(len(pairs))
    if number % OF_A_POOL >= len(pairs):
        return None
    (here, target), (there, source) = (pool[k] for k in pairs[order[number % OF_A_POOL]])
    return Case({here, there}, target, source)


@lru_cache(maxsize=1)
def _pool(maps: RealMaps, number: int) -> list[tuple[str, Grid]]:
    """Return maps with their places: laser maps, mesh maps, storeys, drawn maps, all changed."""
    rng = np.random.default_rng([number, POOL])
    return [_any_style(*_any_place(maps, rng), rng) for _ in range(POOL)]


def _any_place(maps: RealMaps, rng: Random) -> tuple[str, Grid]:
    """Take the map of any place, measured or drawn."""
    source, number = rng.random(), int(rng.integers(5))
    if source < 0.55:
        return maps.any_map(rng)
    if source < 0.7:
        return maps.mesh_map(rng)
    if source < 0.8:
        return maps.floor_map(rng)
    if source < 0.87:
        return (f'corridor {number}', drawings.corridor(
            rng, rng.uniform(1.5, 3.0), rng.uniform(10.0, 80.0), number % 3))
    if source < 0.93:
        return f'office {number}', drawings.office(rng, rng, int(rng.integers(4, 10)))[0]
    width = rng.uniform(8.0, 30.0)
    return f'building {number}', drawings.building(rng, width, width * rng.uniform(0.5, 0.9))


def _any_style(place: str, grid: Grid, rng: Random) -> tuple[str, Grid]:
    """Cut, mirror and furnish some maps, and draw them as some SLAM or sensor does."""
    if rng.random() < 0.4:
        grid = worlds.halves(grid, rng.uniform(-8.0, 5.0), rng)[rng.integers(2)]
    if rng.random() < 0.25:
        grid = worlds.mirrored(grid)
    if rng.random() < 0.2:
        grid = worlds.furnished(grid, rng, int(rng.integers(5, 40)))
    style = int(rng.integers(9))
    if style < 4:
        grid = worlds.drawn_as(grid, rng, style)
    elif style == 4:
        grid = worlds.redrawn(grid, rng.choice([0.02, 0.04, 0.06, 0.08, 0.1]))
    elif style == 5:
        grid = worlds.bend(grid, rng.uniform(0.5, 6.0), rng)[0]
    elif style == 6:
        grid = worlds.scaled(worlds.meshed(grid, rng), rng.uniform(0.97, 1.03))
    elif style == 7:
        grid = worlds.worn(grid, rng, 1.0, 0.3, 0.002)
    return place, worlds.turned(grid, rng)


@kind(300)
def mirrored(maps: RealMaps, rng: Random, number: int) -> Case:
    """Take a map and the mirror image of a map of the same place: different places."""
    place, grid, other = maps.same_place(number, rng)
    return Case({place}, grid, worlds.mirrored(other))


@kind(460)
def gap(maps: RealMaps, rng: Random, number: int) -> Case:
    """Take two parts of one building that do not overlap."""
    place, grid = maps.any_map(rng)
    target, source = worlds.halves(grid, -rng.uniform(0.5, 2.0), rng)
    return Case({place}, target, worlds.turned(source, rng))


@kind(2100)
def corridors(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two corridors of equal width, 10 to 80 m long, with other doors and crossings."""
    width = rng.uniform(1.5, 3.0)
    target, source = (worlds.worn(drawings.corridor(rng, width, rng.uniform(10, 80), number % 3),
                                  rng) for _ in range(2))
    if rng.random() < 0.3:
        source = worlds.bend(source, rng.uniform(0.5, 4.0), rng)[0]
    return Case({f'corridor {number % 5}'}, target, worlds.turned(source, rng))


@kind(290)
def corridor_in_map(maps: RealMaps, rng: Random, number: int) -> Case:
    """Lay a drawn corridor into a real map."""
    place, grid = maps.any_map(rng)
    other = drawings.corridor(rng, rng.uniform(1.5, 3.0), rng.uniform(10.0, 80.0), number % 3)
    return Case({place}, grid, worlds.turned(worlds.worn(other, rng), rng))


@kind(1050)
def offices(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two offices of equal rooms, most with the same layout and other furniture."""
    layouts = rng.integers(10 ** 6, size=2)
    if rng.random() < 0.6:
        layouts[1] = layouts[0]
    target, source = (worlds.worn(drawings.office(
        rng, np.random.default_rng(layout), int(rng.integers(4, 10)))[0], rng)
                      for layout in layouts)
    return Case({f'office {number % 5}'}, target, worlds.turned(source, rng))


@kind(1250)
def buildings(maps: RealMaps, rng: Random, number: int) -> Case:
    """Draw two buildings of different rooms."""
    widths = rng.uniform(5.0, 25.0, 2)
    target, source = (worlds.worn(drawings.building(
        rng, width, width * rng.uniform(0.5, 0.9)), rng) for width in widths)
    return Case({f'building {number % 5}'}, target, worlds.turned(source, rng))


@kind(820)
def storeys(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Draw two storeys of one building: the outer walls and the large areas are the same."""
    width, plan = rng.uniform(10.0, 45.0), int(rng.integers(10 ** 6))
    height = width * rng.uniform(0.5, 0.9)
    planned = width * height * rng.uniform(0.1, 0.6)
    bare = [drawings.building(rng, width, height, np.random.default_rng(plan), planned)
            for _ in range(2)]
    new, both = renovations.changed(*bare)
    if new < 2.0 * (2.0 + RENOVATED * both):
        return None     # one storey, renovated: a wall between two rooms counts twice
    target, source = (worlds.worn(worlds.furnished(one, rng, int(rng.integers(6))), rng)
                      for one in bare)
    return Case({f'storey {number % 5}'}, target, worlds.turned(source, rng))


@kind(680)
def real_storeys(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Draw another storey of a real floor plan: the same shell, other rooms, all else moved."""
    place, grid = maps.any_map(rng)
    area = grid.free.sum() * grid.resolution ** 2
    if area < 40.0:
        return None
    bare = renovations.emptied(grid, rng, 2.5, rng.uniform(0.8, 1.0))
    other = renovations.extended(bare, rng, int(area / rng.uniform(15.0, 60.0)))
    least, new, both = rng.uniform(RENOVATED, 3.0 * RENOVATED), 0.0, area
    for _ in range(8):
        other = renovations.partitioned(other, rng, int(area / 40.0) + 1, 12.0)
        new, both = renovations.changed(bare, other)
        if new > 3.0 + least * both:
            break
    if rng.random() < 0.5:
        shared, sides = rng.uniform(-4.0, 8.0), rng.integers(2, size=2)
        grid, bare, other = (
            worlds.halves(each, shared, np.random.default_rng(number))[side]
            for each, side in ((grid, sides[0]), (bare, sides[0]), (other, sides[1])))
        new, both = renovations.changed(bare, other)
    if both > 4.0 and new < 2.0 + RENOVATED * both:
        return None     # what both show is one storey, renovated
    other = worlds.furnished(other, rng, int(area * rng.uniform(0.04, 0.15)))
    if rng.random() < 0.5:
        other = worlds.bend(other, rng.uniform(0.3, 2.0), rng)[0]
    return Case({place}, grid, worlds.turned(worlds.worn(other, rng, 1.0, 0.2), rng))


@kind(350)
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


@kind(460)
def wings(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Take parts of one storey's plan that do not overlap, or a map of a storey elsewhere."""
    place, grid = maps.floor_map(rng)
    if rng.random() < 0.5:
        target, source = worlds.halves(grid, -rng.uniform(0.5, 3.0), rng)
        return Case({place}, target, worlds.turned(source, rng))
    there, source = maps.mesh_map(rng) if rng.random() < 0.3 else maps.any_map(rng)
    return Case({place, there}, grid, worlds.turned(source, rng))


@kind(0)
def windows(maps: RealMaps, rng: Random, number: int) -> Case | None:
    """Cut small windows, of a room or a crossing, out of maps of different places."""
    (here, target), (there, source) = (_any_place(maps, rng) for _ in range(2))
    if here == there:
        return None
    if rng.random() < 0.5:
        target, _ = worlds.window(target, rng, rng.uniform(8.0, 25.0))
    source, _ = worlds.window(source, rng, rng.uniform(8.0, 25.0))
    return Case({here, there}, target, worlds.turned(worlds.worn(source, rng), rng))


@kind(0)
def hole(maps: RealMaps, rng: Random, number: int) -> Case:
    """Cut a window out of a real map, and match it with what is left."""
    place, grid = maps.any_map(rng)
    source, target = worlds.window(grid, rng, rng.uniform(8.0, 25.0))
    return Case({place}, target, worlds.turned(worlds.worn(source, rng), rng))
