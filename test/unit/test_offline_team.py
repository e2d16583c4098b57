# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several maps at once: one world for those that fit, and the others left out by name."""

from helpers import cut_grid, fake_grid, pose_error
import numpy as np
import pytest
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.grid import Grid
from somfusion_ros.io.result import fusion_record, map_note
from somfusion_ros.simulation.floor_plan import corridor, office
from somfusion_ros.team.offline import fuse, Fusion

PLACES = {'anna': Pose(1.0, -2.0, 0.4), 'ben': Pose(-6.0, 3.0, -2.0), 'carl': Pose(0.0, 9.0, 3.0)}
PARTS = {'anna': (-1.0, 10.5), 'ben': (3.5, 14.0), 'carl': (6.5, 18.0)}


@pytest.fixture(scope='module')
def grids() -> dict[str, Grid]:
    """Make three parts of one floor, each in a map frame of its own, and another floor."""
    floor, found = fake_grid(office().segments), {}
    for name, (low, high) in PARTS.items():
        part = cut_grid(floor, (low, -1.0), (high, 11.0))
        placed = Pose.from_array(compose(PLACES[name], part.T_frame_grid))
        found[name] = Grid(part.evidence, part.resolution, placed)
    found['zoe'] = cut_grid(fake_grid(corridor().segments), (-1.0, -1.0), (9.0, 10.0))
    return found


@pytest.fixture(scope='module')
def fused(grids: dict[str, Grid]) -> Fusion:
    """Fuse all four maps."""
    return fuse(grids, traced=False)


def test_every_pair_is_tried_once(fused: Fusion) -> None:
    assert [(p.target, p.source) for p in fused.pairs] == [
        ('anna', 'ben'), ('anna', 'carl'), ('anna', 'zoe'), ('ben', 'carl'), ('ben', 'zoe'),
        ('carl', 'zoe')]


def test_maps_of_one_floor_meet_in_one_world(fused: Fusion) -> None:
    assert set(fused.world) == {'anna', 'ben', 'carl'}
    assert fused.world['anna'] == pytest.approx((0.0, 0.0, 0.0))
    for name in ('ben', 'carl'):
        # PLACES hold T_map_floor, so T_anna_name = T_anna_floor * T_floor_name.
        true = compose(PLACES['anna'], inverse(PLACES[name]))
        distance, angle = pose_error(fused.world[name], true)
        assert distance < 0.15
        assert angle < np.radians(1.0)


def test_the_stranger_stays_outside(fused: Fusion) -> None:
    assert fused.unconnected == ['zoe']
    assert not any(p.alignment.accepted for p in fused.pairs if p.source == 'zoe')


def test_global_map_and_index_of_the_whole(fused: Fusion, grids: dict[str, Grid]) -> None:
    floor = fake_grid(office().segments)
    area = fused.global_map.free.sum() * fused.global_map.resolution ** 2
    assert area == pytest.approx(floor.free.sum() * floor.resolution ** 2, rel=0.05)
    assert 90.0 < fused.verification_index <= 100.0


def test_a_pair_does_not_depend_on_the_others(fused: Fusion, grids: dict[str, Grid]) -> None:
    alone = fuse({name: grids[name] for name in ('ben', 'carl')}, traced=False)
    among = next(p for p in fused.pairs if (p.target, p.source) == ('ben', 'carl'))
    assert alone.pairs[0].alignment.T_target_source == among.alignment.T_target_source


def test_record_names_everything(fused: Fusion) -> None:
    record = fusion_record(fused)
    assert set(record['transforms']) == {'anna', 'ben', 'carl'}
    assert record['unconnected'] == ['zoe']
    assert len(record['pairs']) == 6
    assert set(record['map_of']) == {'anna', 'ben', 'carl'}
    assert record['map_note'] == (f'the joint map is that of {", ".join(record["map_of"])}; '
                                  'not in it: zoe in zoe/map.yaml')


def test_two_groups_are_told_apart() -> None:
    """The map shows one of them; nobody is to think that the others were joined to nothing."""
    assert map_note([['a', 'b']]) == map_note([['a']]) == ''
    assert map_note([['a', 'b'], ['c', 'd'], ['e']]) == (
        'the joint map is that of a, b; not in it: c in c/map.yaml, d in d/map.yaml, e in '
        'e/map.yaml; joined with one another, but not drawn: c and d')
