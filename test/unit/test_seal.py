# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Signatures, and the seals that robots set under what they say."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.ed25519 import public_key, sign, verify
from somfusion_ros.team.outbox import Outbox
from somfusion_ros.team.seal import SealChecks
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.state_codec import decode_state
from test_liars import cpu

# RFC 8032, section 7.1: secret key, public key, message, signature.
VECTORS = [
    ('9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60',
     'd75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a', '',
     'e5564300c360ac729086e2cc806e828a84877f1eb8e5d974d873e065224901555fb8821590a33bacc61e39701cf9'
     'b46bd25bf5f0595bbe24655141438e7a100b'),
    ('4ccd089b28ff96da9db6c346ec114e0f5b8a319f35aba624da8cf6ed4fb8a6fb',
     '3d4017c3e843895a92b70aa74d1b7ebc9c982ccf2ec4968cc0cd55f12af4660c', '72',
     '92a009a9f0d4cab8720e820b5f642540a2b27b5416503f8fb3762223ebdb69da085ac1e43e15996e458f3613d0f1'
     '1d8c387b2eaeb4302aeeb00d291612bb0c00')]
SECRET = bytes(range(32))
SAID = (MapConstraint('a', 'b', Pose(1.0 / 3, 2.0, 0.1), np.diag([0.01, 0.02, 1e-4]), 0.9),
        MapConstraint('c', 'a', Pose(-1.0, 2.0, 3.1), np.diag([0.01, 0.02, 1e-4]), 0.99,
                      'sighting'))


@pytest.mark.parametrize(('secret', 'public', 'message', 'signature'), VECTORS)
def test_signatures_are_those_of_the_standard(secret: str, public: str, message: str,
                                              signature: str) -> None:
    key, text = bytes.fromhex(secret), bytes.fromhex(message)
    assert public_key(key).hex() == public
    assert sign(key, text).hex() == signature
    assert verify(bytes.fromhex(public), text, bytes.fromhex(signature))


@settings(max_examples=25, deadline=None)
@given(st.binary(max_size=40), st.integers(0, 95), st.integers(1, 255))
def test_a_flipped_bit_is_noticed(message: bytes, at: int, flip: int) -> None:
    key, signature = public_key(SECRET), sign(SECRET, message)
    both = bytearray(key + signature)
    both[at] ^= flip
    assert verify(key, message, signature)
    assert not verify(bytes(both[:32]), message, bytes(both[32:]))
    assert not verify(key, message + b'x', signature)


@pytest.mark.parametrize('key', [b'', bytes(31), bytes(33), 32 * b'\xff'])
def test_no_key_and_no_signature_is_no_error(key: bytes) -> None:
    signature = sign(SECRET, b'')
    assert not verify(key, b'', signature)
    assert not verify(public_key(SECRET), b'', key)


def test_a_robot_seals_what_it_tells_and_others_can_tell() -> None:
    """Also after it was written and read; what it says again has the same seal."""
    outbox, checks = Outbox('ab12', 'a', SECRET), SealChecks()
    snapshot = Snapshot(constraints=SAID, epoch=Epoch('1f'))
    states = [decode_state(text) for text in (
        outbox.state(snapshot, 0, 0.0), outbox.state(snapshot, 0, 60.0),
        outbox.state(replace(snapshot, constraints=SAID[:1]), 0, 61.0)) if text]
    assert [state.seal.number for state in states if state.seal] == [1, 1, 2]
    first, _, last = states
    assert first.seal is not None
    assert last.seal is not None
    for said in (first.constraints, first.constraints[::-1]):     # in whatever order
        assert checks.hold(first.seal, 'a', Epoch('1f'), said)
    assert checks.hold(last.seal, 'a', Epoch('1f'), last.constraints)
    for seal, robot, epoch, said in (
            (last.seal, 'a', Epoch('1f'), first.constraints),
            (first.seal, 'b', Epoch('1f'), first.constraints),
            (first.seal, 'a', Epoch('1f', 1), first.constraints),
            (first.seal._replace(number=9), 'a', Epoch('1f'), first.constraints)):
        assert not checks.hold(seal, robot, epoch, said)


def test_who_has_no_map_seals_nothing() -> None:
    text = Outbox('ab12', 'a', SECRET).state(Snapshot(), 0, 0.0)
    assert text is not None
    assert decode_state(text).seal is None


def test_to_seal_and_to_check_takes_milliseconds() -> None:
    verify(public_key(SECRET), b'', sign(SECRET, b''))
    assert cpu(lambda: sign(SECRET, b'x'))[0] < 0.05
    assert cpu(lambda: verify(public_key(SECRET), b'x', sign(SECRET, b'')))[0] < 0.1


def test_a_pair_that_is_known_better_is_told_a_little_later_and_a_new_one_at_once() -> None:
    outbox = Outbox('ab12', 'a', SECRET)
    snapshot = Snapshot(constraints=SAID, epoch=Epoch('1f'))
    finer = replace(snapshot, constraints=(replace(SAID[0], probability=0.95), SAID[1]))
    told = [outbox.state(*given) for given in (
        (snapshot, 0, 0.0), (finer, 0, 1.0), (finer, 0, 3.5), (finer, 0, 4.0),
        (replace(finer, constraints=SAID[:1]), 0, 4.1),
        (replace(finer, constraints=SAID[:1], refuted=('b',)), 0, 4.2))]
    assert [bool(text) for text in told] == [True, False, True, False, True, True]
    states = [decode_state(text) for text in told if text]
    assert [state.number for state in states] == [1, 2, 3, 4]
    assert states[1].constraints[0].probability == 0.95
