# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of bonds: whatever comes late, doubled or out of order, what was told last counts."""

from hypothesis import given
from hypothesis import strategies as st
import pytest
from somfusion_ros.team.bond_message import BondHearer, BondMessage, BondTeller, GONE_KEPT
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.view_inbox import MOST_BATCHES, ViewInbox

SESSION = st.text('0123456789abcdef', min_size=1, max_size=32)


@given(session=SESSION, number=st.integers(0, 2 ** 32 - 1), bonds=st.binary(max_size=50),
       cut=st.integers(0, 40))
def test_a_message_is_read_as_it_was_told_and_a_part_of_its_head_is_refused(
        session: str, number: int, bonds: bytes, cut: int) -> None:
    message = BondMessage(session, number, bonds)
    data = message.encode()
    assert BondMessage.decode(data) == message
    head = len(data) - len(bonds)
    with pytest.raises(ValueError, match='a message of bonds'):
        BondMessage.decode(data[:min(cut, head - 1)])


@given(data=st.binary(max_size=60))
def test_noise_is_a_message_or_refused_with_a_line(data: bytes) -> None:
    try:
        assert BondMessage.decode(data).encode() == data
    except ValueError as error:
        assert 'a message of bonds' in str(error)


@given(order=st.permutations([1, 1, 2, 3, 4, 4]), again=st.booleans())
def test_the_last_of_a_session_counts_in_any_order(order: list[int], again: bool) -> None:
    told: list[bytes] = []
    counted: list[str] = []
    inbox = ViewInbox(_taking(told), {'robot1': Heard()},
                      lambda kind, reason='': counted.append(kind), lambda: 0.0)
    for number in order:
        inbox.keep_bonds('robot1', BondMessage('one', number, b'%d' % number).encode())
        if again:
            inbox.drain()
    inbox.drain()
    assert told[-1] == b'4'
    inbox.keep_bonds('robot1', BondMessage('two', 1, b'after a restart').encode())
    inbox.keep_bonds('robot1', BondMessage('one', 5, b'late, of before it').encode())
    inbox.keep_bonds('robot1', b'\1')
    inbox.drain()
    assert told[-1] == b'after a restart'
    assert counted == ['bonds_of_robot1_unusable']


def test_bonds_are_told_where_they_changed() -> None:
    teller, hearer = BondTeller('one'), BondHearer()
    told = [teller.more(bonds) for bonds in (b'none', b'none', b'one', b'none')]
    assert [message is None for message in told] == [False, True, False, False]
    messages = [BondMessage.decode(message) for message in told if message is not None]
    for message in (messages[1], messages[0], messages[2], messages[0]):
        hearer.keep('robot1', message)
    assert [hearer.take('robot1', 'one') for _ in range(2)] == [b'none', None]


def test_bonds_count_whose_session_the_state_names() -> None:
    """Another robot spoke under the name for a while; then the first one is heard again."""
    told: list[bytes] = []
    heard = {'robot1': Heard()}
    inbox = ViewInbox(_taking(told), heard, lambda *_: None, lambda: 0.0)
    for session, at in (('one', 0.0), ('other', 1.0), ('one', 100.0)):
        heard['robot1'].begin(session, at)
        heard['robot1'].taken_until = 0.0
        if at < 100.0:
            inbox.keep_bonds('robot1', BondMessage(session, 1, session.encode()).encode())
        inbox.drain()
    assert told == [b'one', b'other', b'one']
    inbox.keep_bonds('robot1', BondMessage('next', 1, b'before its state').encode())
    inbox.drain()
    assert told[-1] == b'one'
    heard['robot1'].begin('next', 101.0)
    inbox.drain()
    assert told[-1] == b'before its state'


def _taking(told: list[bytes]) -> object:
    """Return an elastic session that notes the bonds that it is handed."""
    class Elastic:
        def take_bonds(self, robot: str, bonds: bytes) -> None:
            told.append(bonds)

        take_views = take_bonds
    return Elastic()


def test_of_a_robot_that_is_heard_no_more_no_bonds_are_kept() -> None:
    """However many names come and go: a message may have a megabyte, and eight sessions count."""
    hearer = BondHearer()
    hearer.keep('z', BondMessage('ab', 1, b'bonds'))
    assert hearer.take('z', 'ab') == b'bonds'
    hearer.forget('z')
    assert hearer.take('z', 'ab') is None
    assert not hearer._taken and not any(hearer._newest.values())
    assert hearer.robots() == ['z'], 'what others hand on of it is older'
    for number in range(2 * GONE_KEPT):
        hearer.keep(f'z{number}', BondMessage('ab', 1, b'bonds'))
        hearer.forget(f'z{number}')
    hearer.keep('here', BondMessage('ab', 1, b'bonds'))
    assert hearer.robots() == [*(f'z{number}' for number in range(GONE_KEPT, 2 * GONE_KEPT)),
                               'here']


def test_batches_that_are_too_many_are_refused_and_counted() -> None:
    """The oldest would go silently; and of names that came and went nothing is left."""
    told: list[bytes] = []
    counted: list[str] = []
    inbox = ViewInbox(_taking(told), {}, lambda kind, reason: counted.append(f'{kind}: {reason}'),
                      lambda: 0.0)
    for number in range(MOST_BATCHES + 2):
        inbox.keep_batch('robot1', b'%d' % number)
    assert counted == 2 * ['views_of_robot1_unusable: over 4096 batches wait']
    inbox.drain()
    assert told[0] == b'0' and len(told) == MOST_BATCHES
    assert not inbox._batches
