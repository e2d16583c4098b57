# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Clusters alone tell whether whole maps are worth sending: no true pair is missed."""

import csv

from helpers import cut_grid, fake_grid, fake_room, furnished_room, need_data
import numpy as np
import pytest
from somfusion_ros.fusion.learning import learn
from somfusion_ros.geometry import Pose
from somfusion_ros.grid import Grid
from somfusion_ros.team.screening import BUDGET, outline, screen, Screening

ROOMS = {seed: furnished_room(*np.random.default_rng(seed).uniform((8, 7), (14, 11)), seed)
         for seed in range(6)}
ROW_BYTES = 28      # of one cluster on the wire
MOST_BYTES = 20000


@pytest.mark.parametrize('seed', ROOMS)
def test_two_views_of_a_room_are_likely_and_other_rooms_mostly_not(seed: int) -> None:
    whole = fake_grid(ROOMS[seed])
    half = cut_grid(whole, (-1.0, -1.0), (6.0, 12.0))
    turned = fake_grid(ROOMS[seed], T_map_walls=Pose(3.0, -2.0, 2.0))
    assert screen(learn(half), outline(learn(turned))).likely
    assert screen(learn(turned), outline(learn(half))).likely
    others = [screen(learn(whole), outline(learn(fake_grid(walls)))).likely
              for other, walls in ROOMS.items() if other != seed]
    assert sum(others) <= 2     # of 5; a map that is sent for nothing is the only harm


def test_a_large_map_keeps_to_its_budget_and_is_still_found() -> None:
    walls = furnished_room(60.0, 45.0)
    large = learn(fake_grid(walls))
    assert len(large.clusters) > 2 * BUDGET
    assert ROW_BYTES * len(outline(large)) <= MOST_BYTES
    part = cut_grid(fake_grid(walls, T_map_walls=Pose(1.0, 2.0, 0.0)), (0.0, 0.0), (30.0, 30.0))
    assert screen(learn(part), outline(large)).likely


def test_maps_that_show_too_little_are_not_likely() -> None:
    empty = Grid(np.zeros((5, 5), np.float32), 0.05)
    room = learn(fake_grid(fake_room()))
    assert screen(room, outline(learn(empty))) == Screening()
    assert screen(learn(empty), outline(room)) == Screening()
    assert not Screening().likely


def test_no_true_pair_of_real_maps_is_missed() -> None:
    folder = need_data('pairs')
    with (folder / 'manifest.csv').open() as file:
        names = [row['name'] for row in csv.DictReader(file) if row['kind'] == 'pos'][::4]
    missed = []
    for name in names:
        with np.load(folder / f'{name}.npz') as pair:
            maps = [learn(Grid.from_occupancy(pair[which], float(pair['resolution'])))
                    for which in ('target', 'source')]
        if not any(screen(one, outline(other)).likely for one, other in (maps, maps[::-1])):
            missed.append(name)
    assert len(names) >= 20
    assert not missed
