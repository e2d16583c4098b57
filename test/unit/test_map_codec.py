# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Maps as bytes: what arrives is the sender's map or nothing, and a small change is small."""

from itertools import permutations
import struct

from helpers import fake_grid, fake_room
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import compose, Pose
from somfusion_ros.team.map_codec import HEADER, MapDecoder, MapEncoder
from somfusion_ros.team.shared_map import DRIVEN, MapCells, mark_driven, SharedMap

LIMIT = 10 ** 7
ROOM = fake_grid(fake_room())
CELLS = MapCells(ROOM.to_occupancy(), ROOM.resolution, ROOM.T_frame_grid)


def same(one: MapCells | None, other: MapCells) -> bool:
    """Tell whether two maps are equal, bit by bit."""
    return (one is not None and np.array_equal(one.values, other.values)
            and one[1:] == other[1:])


def grown(cells: MapCells, low: tuple[int, int], high: tuple[int, int]) -> MapCells:
    """Add unknown rows and columns before and after."""
    corner = (-low[1] * cells.resolution, -low[0] * cells.resolution, 0.0)
    return MapCells(np.pad(cells.values, tuple(zip(low, high)), constant_values=-1),
                    cells.resolution, Pose.from_array(compose(cells.T_frame_grid, corner)))


def painted(cells: MapCells, row: int, column: int, value: int) -> MapCells:
    """Change one square of cells."""
    values = cells.values.copy()
    values[row:row + 5, column:column + 5] = value
    return cells._replace(values=values)


def test_a_key_gives_the_map_and_is_much_smaller() -> None:
    encoder = MapEncoder()
    encoder.encode(CELLS)
    assert encoder.change is None
    assert same(MapDecoder(LIMIT).decode(encoder.key), CELLS)
    assert len(encoder.key) < CELLS.values.size / 20


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10 ** 6))
def test_any_history_of_a_map_arrives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    encoder, decoder, cells = MapEncoder(), MapDecoder(LIMIT), CELLS
    for _ in range(6):
        encoder.encode(cells)
        for message in filter(None, (encoder.key, encoder.change)):
            got = decoder.decode(message)
        assert same(got, cells)
        low, high = rng.integers(-3, 8, (2, 2))
        cells = grown(painted(cells, *rng.integers(5, 60, 2), int(rng.integers(-2, 101))),
                      tuple(np.maximum(low, 0)), tuple(np.maximum(high, 0)))
        if rng.random() < 0.3:   # a map may lose rows as well
            cells = MapCells(cells.values[2:-1, 1:], cells.resolution, Pose.from_array(compose(
                cells.T_frame_grid, (cells.resolution, 2 * cells.resolution, 0.0))))
        if rng.random() < 0.2:   # or begin anew on another lattice
            cells = cells._replace(T_frame_grid=Pose(*rng.uniform(-3, 3, 3)))


def test_a_small_change_costs_a_small_message() -> None:
    encoder = MapEncoder()
    encoder.encode(CELLS)
    key = encoder.key
    encoder.encode(grown(painted(CELLS, 50, 60, 100), (7, 3), (0, 9)))
    assert encoder.key is key
    assert len(encoder.change) < 200


def test_changes_never_cost_more_than_two_keys_between_two_keys() -> None:
    rng, encoder, cells = np.random.default_rng(0), MapEncoder(), CELLS
    encoder.encode(cells)
    key, spent, keys = encoder.key, 0, 0
    for _ in range(60):
        cells = painted(cells, *rng.integers(0, 100, 2), int(rng.integers(0, 101)))
        encoder.encode(cells)
        if encoder.key is key:
            spent += len(encoder.change)
            assert spent < 2 * len(key)
        else:
            key, spent, keys = encoder.key, 0, keys + 1
    assert 2 < keys < 30


def test_late_doubled_and_disordered_messages_do_no_harm() -> None:
    encoder, messages, states = MapEncoder(), [], []
    for cells in (CELLS, painted(CELLS, 20, 20, 100), painted(CELLS, 30, 40, 0)):
        encoder.encode(cells)
        messages.append(encoder.change or encoder.key)
        states.append(cells)
    for order in permutations(range(3)):
        decoder = MapDecoder(LIMIT)
        got = [decoder.decode(messages[k]) for k in (*order, *order) for _ in range(2)]
        assert all(any(same(cells, state) for state in states)
                   for cells in got if cells is not None)
        last = max(k for k in order if k)
        assert got[-1] is not None
        assert same(decoder.decode(messages[last]), states[last])


def test_a_change_waits_for_its_key() -> None:
    encoder = MapEncoder()
    encoder.encode(CELLS)
    key = encoder.key
    encoder.encode(painted(CELLS, 50, 60, 100))
    decoder = MapDecoder(LIMIT)
    assert decoder.decode(encoder.change) is None
    assert same(decoder.decode(key), painted(CELLS, 50, 60, 100))


def message_with(**changes: float) -> bytes:
    """Make a key whose header was changed."""
    encoder = MapEncoder()
    encoder.encode(CELLS)
    names = ('kind', 'key', 'digest', 'rows', 'columns', 'resolution', 'x', 'y', 'theta',
             'key_row', 'key_column', 'row', 'column', 'height', 'width')
    values = dict(zip(names, HEADER.unpack_from(encoder.key), strict=True)) | changes
    return HEADER.pack(*values.values()) + encoder.key[HEADER.size:]


@pytest.mark.parametrize('changes', [
    {'kind': b'garbage'}, {'rows': 0}, {'rows': 10 ** 6, 'columns': 10 ** 6},
    {'rows': CELLS.values.shape[0] + 1}, {'resolution': 0.0}, {'resolution': 1e-9},
    {'resolution': float('nan')}, {'x': float('nan')}, {'x': 1e300}, {'theta': float('inf')},
    {'height': 5}, {'row': 1}, {'key_row': 2 ** 30}, {'width': 2 ** 31}])
def test_a_message_that_lies_is_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match='.'):
        MapDecoder(LIMIT).decode(message_with(**changes))


def test_a_bomb_is_not_blown_up() -> None:
    encoder = MapEncoder()
    encoder.encode(MapCells(np.zeros((3000, 3000), np.int8), 0.05, Pose()))
    with pytest.raises(ValueError, match='over 1000000'):
        MapDecoder(10 ** 6).decode(encoder.key)
    small = struct.pack('<II', 10, 10)
    lie = encoder.key[:23] + small + encoder.key[31:-16] + small + encoder.key[-16:]
    with pytest.raises(ValueError, match='.'):
        MapDecoder(10 ** 6).decode(lie)


def test_noise_of_any_kind_raises_nothing_but_value_errors() -> None:
    rng, decoder = np.random.default_rng(3), MapDecoder(LIMIT)
    encoder = MapEncoder()
    encoder.encode(CELLS)
    decoder.decode(encoder.key)
    encoder.encode(painted(CELLS, 50, 60, 100))
    refused = 0
    for number in range(4000):
        message = bytearray((encoder.key, encoder.change)[number % 2])
        for _ in range(rng.integers(1, 4)):
            message[rng.integers(len(message))] = rng.integers(256)
        try:
            got = decoder.decode(bytes(message[:rng.integers(len(message) + 1)]
                                       if number % 3 else message))
        except ValueError:
            refused += 1
        else:
            assert got is None or same(got, CELLS) or same(got, painted(CELLS, 50, 60, 100))
    assert refused > 3500
    assert same(decoder.decode(encoder.key), painted(CELLS, 50, 60, 100)) or same(
        decoder.decode(encoder.key), CELLS)


def test_where_a_robot_has_driven_travels_with_its_map() -> None:
    path = [(1.0, 1.0), (2.0, 1.0), (3.0, 1.0), (3.0, 2.0), (100.0, 100.0), (1e300, 0.0)]
    marked = mark_driven(CELLS, path)
    encoder = MapEncoder()
    encoder.encode(marked)
    shared = SharedMap.from_cells(MapDecoder(LIMIT).decode(encoder.key))
    near = np.abs(shared.driven[:, None] - np.array(path[:4])).max(-1).min(0)
    assert (near <= ROOM.resolution).all()
    assert len(shared.driven) >= np.count_nonzero(marked.values == DRIVEN) > 35
    assert (shared.grid.evidence[marked.values != DRIVEN]
            == ROOM.evidence[marked.values != DRIVEN]).all()


def test_a_path_of_no_or_one_place_is_marked() -> None:
    assert same(mark_driven(CELLS, []), CELLS)
    assert np.count_nonzero(mark_driven(CELLS, [(1.0, 1.0)]).values == DRIVEN) == 1
