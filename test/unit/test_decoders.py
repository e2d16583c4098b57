# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Every decoder of what the team says: round trips, and whatever else comes is one ValueError."""

import json
import tracemalloc
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.last_words import DepartedRobot
from somfusion_ros.team.map_codec import epoch_of, HEADER, MapDecoder, MapEncoder
from somfusion_ros.team.seal import Seal
from somfusion_ros.team.shared_map import DRIVEN, MapCells
from somfusion_ros.team.state_codec import decode_state, encode_state, TeamState
from somfusion_ros.team.whereabouts import Whereabouts

few = settings(max_examples=40, deadline=None)
MOST_CELLS = 10 ** 4
BOUND = 2 ** 21        # bytes that a message may allocate before it is refused, at MOST_CELLS
NAMES = st.from_regex(r'[a-z][a-z0-9]{0,8}(/[a-z]{1,4})?', fullmatch=True)
EPOCHS = st.builds(Epoch, st.from_regex('[0-9a-z]{1,19}', fullmatch=True),
                   st.integers(0, 10 ** 9 - 1), st.from_regex('[0-9a-z]{0,12}', fullmatch=True))
NUMBERS = st.floats(-1e4, 1e4)
POSES = st.builds(Pose, NUMBERS, NUMBERS, st.floats(-3.1, 3.1))
SIGMAS = st.lists(st.floats(1e-3, 5.0), min_size=3, max_size=3)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner,
                                                                max_size=4), max_leaves=12)


@st.composite
def constraints(draw: Any) -> MapConstraint:
    """Make a constraint."""
    target, source = draw(st.lists(NAMES, min_size=2, max_size=2, unique=True))
    return MapConstraint(target, source, draw(POSES), np.diag(np.square(draw(SIGMAS))),
                         draw(st.floats(0, 1)), draw(st.sampled_from(('match', 'sighting'))),
                         (draw(EPOCHS), draw(EPOCHS)))


METRES = st.integers(-1000, 1000).map(lambda number: number / 100)
PLACES = st.tuples(st.tuples(METRES, METRES), st.tuples(METRES, METRES))
WHEREABOUTS = st.builds(Whereabouts, NAMES, st.tuples(EPOCHS, EPOCHS),
                        st.lists(PLACES, max_size=3).map(tuple))
SEALS = st.none() | st.builds(Seal, st.binary(min_size=32, max_size=32), st.integers(0, 2 ** 61),
                              st.binary(min_size=64, max_size=64))
STATES = st.builds(
    TeamState, st.from_regex('[0-9a-z]{1,32}', fullmatch=True),
    st.lists(constraints(), max_size=4).map(tuple),
    st.lists(st.builds(DepartedRobot, NAMES, st.integers(0, 10 ** 9),
                       st.lists(constraints(), max_size=2).map(tuple), EPOCHS, SEALS),
             max_size=2).map(tuple),
    st.none() | EPOCHS, st.integers(0, 2 ** 61), st.integers(0, 2 ** 61),
    st.lists(WHEREABOUTS, max_size=2).map(tuple), st.lists(NAMES, max_size=2).map(tuple),
    st.none() | EPOCHS, SEALS, st.dictionaries(NAMES, EPOCHS, max_size=2))


@st.composite
def maps(draw: Any) -> MapCells:
    """Make a map."""
    height, width = draw(st.integers(1, 12)), draw(st.integers(1, 12))
    values = draw(st.lists(st.sampled_from((-1, 0, 40, 100, DRIVEN)), min_size=height * width,
                           max_size=height * width))
    return MapCells(np.array(values, np.int8).reshape(height, width),
                    draw(st.floats(0.01, 1.0)), draw(POSES))


def same(one: MapConstraint, other: MapConstraint) -> bool:
    """Return whether two constraints say the same, to the last digit."""
    return (one.robots == other.robots and one.T_target_source == other.T_target_source
            and np.array_equal(one.covariance, other.covariance) and one.kind == other.kind
            and one.probability == other.probability and one.epochs == other.epochs)


@few
@given(STATES)
def test_a_state_comes_back_to_the_last_digit(state: TeamState) -> None:
    again = decode_state(encode_state(state))
    rest = {'constraints': (), 'departed': ()}
    assert again._replace(**rest) == state._replace(**rest)
    assert all(map(same, again.constraints, state.constraints))
    assert len(again.constraints) == len(state.constraints)
    for one, other in zip(again.departed, state.departed, strict=True):
        assert (one.robot, one.known, one.epoch, one.seal) == (
            other.robot, other.known, other.epoch, other.seal)
        assert all(map(same, one.constraints, other.constraints))


def refused(text: str) -> str:
    """Read a state that may be none; return the reason, '' where it is one."""
    try:
        decode_state(text)
    except ValueError as error:
        assert '\n' not in str(error)
        assert len(str(error)) < 600
        return str(error)
    return ''


@few
@given(STATES, st.integers(0, 10 ** 6))
def test_a_state_that_was_cut_is_refused(state: TeamState, at: int) -> None:
    text = encode_state(state)
    assert refused(text[:at % len(text)])


@few
@given(STATES, st.integers(0, 10 ** 6), st.characters())
def test_a_state_with_another_letter_is_one_or_is_refused(state: TeamState, at: int,
                                                          letter: str) -> None:
    text = encode_state(state)
    at %= len(text)
    refused(text[:at] + letter + text[at + 1:])


@few
@given(JSON)
def test_any_document_is_refused(document: Any) -> None:
    assert refused(json.dumps(document))


@few
@given(STATES, st.sampled_from(('version', 'session', 'number', 'epoch', 'since', 'constraints',
                                'departed', 'whereabouts',
                                'refuted')), JSON)
def test_any_value_in_any_place_is_read_or_refused(state: TeamState, key: str,
                                                   value: Any) -> None:
    record = json.loads(encode_state(state))
    record[key] = value
    refused(json.dumps(record))


@few
@given(constraints(), st.sampled_from(('target', 'source', 'kind', 'epochs', 'pose', 'probability',
                                       'covariance')), JSON)
def test_any_value_in_any_place_of_a_constraint_is_read_or_refused(
        one: MapConstraint, key: str, value: Any) -> None:
    record = json.loads(encode_state(TeamState('a1', (one,))))
    record['constraints'][0][key] = value
    refused(json.dumps(record))


@pytest.mark.parametrize('text', ['[' * 10 ** 5, '{"version": ' + '9' * 10 ** 5 + '}', '\ud800',
                                  '{"version": 1}', 'null', '"' * 3, '1e999', ' ' * 2 ** 19])
def test_documents_that_are_meant_to_hurt_are_refused(text: str) -> None:
    assert refused(text)


@few
@given(maps(), maps(), EPOCHS)
def test_a_map_and_its_change_come_back(first: MapCells, second: MapCells, epoch: Epoch) -> None:
    encoder, decoder = MapEncoder(), MapDecoder(MOST_CELLS)
    for cells in (first, second):
        encoder.encode(cells, epoch)
        messages = [encoder.key] + ([encoder.change] if encoder.change else [])
        for message in messages:
            assert epoch_of(message) == epoch
            again = decoder.decode(message)
        assert again is not None
        assert np.array_equal(again.values, cells.values)
        assert again[1:] == cells[1:]


@few
@given(maps(), st.data())
def test_a_map_message_that_is_cut_or_flipped_is_refused_at_little_cost(
        cells: MapCells, data: Any) -> None:
    encoder, decoder = MapEncoder(), MapDecoder(MOST_CELLS)
    encoder.encode(cells, Epoch('1f'))
    message = bytearray(encoder.key)
    if data.draw(st.booleans()):
        message = message[:data.draw(st.integers(0, len(message) - 1))]
    else:
        at = data.draw(st.integers(0, len(message) - 1))
        message[at] ^= data.draw(st.integers(1, 255))
    tracemalloc.start()
    try:
        decoder.decode(bytes(message))
    except ValueError as error:
        assert '\n' not in str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peak < BOUND


@few
@given(st.binary(max_size=400), st.tuples(*[st.integers(0, 2 ** 32 - 1)] * 2))
def test_any_bytes_behind_any_sizes_are_refused_at_little_cost(
        noise: bytes, size: tuple[int, int]) -> None:
    header = HEADER.pack(b'SOMKEY2', b'1f.0', 1, b'', b'', *size, 0.05, 0, 0, 0, 0, 0, 0, 0, *size)
    tracemalloc.start()
    with pytest.raises(ValueError):
        MapDecoder(MOST_CELLS).decode(header + noise)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < BOUND
