# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot tells of its views comes through, and nothing else does harm."""

from dataclasses import replace

from helpers import checkpoint, fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.scan import Cloud, cloud
from somfusion_ros.team.beam_code import decode_beams, encode_beams, MAX_BEAMS
from somfusion_ros.team.compact import pack, pack_covariance, pack_scaled, STEP as POSE_STEP
from somfusion_ros.team.compact import unpack
from somfusion_ros.team.teller import tell, Teller
from somfusion_ros.team.view_facts import (decode_constraint, decode_view, encode_constraint,
                                           Facts, heard, TUNING, ViewFact)

STEP = 0.015     # [m] of a range that is told


def seen_from(pose: Array, twist: Array | None = None, sweep: float = 0.0, beams: int = 361
              ) -> Cloud:
    """Scan the fake room while the robot moves."""
    scan = fake_scan(fake_room(), pose, beams=beams, T_base_laser=Pose(0.1, -0.05, 0.3))
    return cloud(replace(scan, time_increment=sweep / beams), 20.0, twist)


@pytest.mark.slow
@given(x=st.floats(1.0, 6.5), y=st.floats(1.0, 2.4), theta=st.floats(-3.0, 3.0),
       speed=st.floats(-1.0, 1.0), turn=st.floats(-1.5, 1.5), beams=st.sampled_from([90, 361]))
@settings(max_examples=60, deadline=None)
def test_beams_come_through(x: float, y: float, theta: float, speed: float, turn: float,
                            beams: int) -> None:
    seen = seen_from(np.array([x, y, theta]), np.array([speed, 0.0, turn]), 0.1, beams)
    back = decode_beams(encode_beams(seen.outline))
    assert np.array_equal(back.outline.hit, seen.outline.hit)
    off = np.hypot(*(back.outline.ends - seen.outline.ends)[seen.outline.hit].T)
    assert off.max(initial=0.0) < 0.55 * STEP      # and what single precision costs
    assert np.abs(back.outline.reach - seen.outline.reach).max() < 0.51 * STEP
    assert np.allclose(back.outline.origin, seen.outline.origin, atol=6e-5)


def test_a_view_costs_few_bytes() -> None:
    sizes = [len(encode_beams(seen_from(np.array([x, 1.5, x])).outline))
             for x in np.linspace(1.0, 6.5, 20)]
    assert 60 < np.mean(sizes) < 420     # 361 beams of a room without noise


def test_what_is_told_twice_is_the_same() -> None:
    """A robot uses its own facts as its peers do: packing what was unpacked changes nothing."""
    told = encode_beams(seen_from(np.array([2.0, 2.0, 1.0])).outline)
    once, twice = decode_beams(told), decode_beams(told)
    assert np.array_equal(once.points, twice.points)


@given(cut=st.integers(0, 400))
@settings(max_examples=40, deadline=None)
def test_a_cut_view_is_refused(cut: int) -> None:
    told = encode_beams(seen_from(np.array([2.0, 2.0, 1.0])).outline)
    if cut < len(told):
        with pytest.raises(ValueError, match='view'):
            decode_beams(told[:cut])


@given(noise=st.binary(min_size=0, max_size=200), at=st.integers(0, 300), bit=st.integers(0, 7))
@settings(max_examples=150, deadline=None)
def test_garbage_ends_in_a_value_error_or_a_small_view(noise: bytes, at: int, bit: int) -> None:
    told = bytearray(encode_beams(seen_from(np.array([2.0, 2.0, 1.0])).outline))
    told[at % len(told)] ^= 1 << bit
    for data in (noise, bytes(told), bytes(told) + noise):
        try:
            seen = decode_beams(data)
        except ValueError:
            continue
        assert len(seen.outline.reach) <= MAX_BEAMS
        assert np.isfinite(seen.points).all()


def test_a_bomb_is_refused() -> None:
    head = pack((361,)) + pack_scaled(np.zeros(6), np.ones(6))
    import zlib
    packer = zlib.compressobj(9, wbits=-15)
    bomb = packer.compress(bytes(50_000_000)) + packer.flush()
    with pytest.raises(ValueError, match='damaged'):
        decode_beams(head + bomb)


@given(z=st.tuples(*[st.floats(-50.0, 50.0)] * 3), sigma=st.tuples(*[st.floats(1e-6, 5.0)] * 3),
       turn=st.floats(-3.0, 3.0))
@settings(max_examples=80, deadline=None)
def test_constraints_come_through_with_a_floor(z: tuple, sigma: tuple, turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    Q = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    R = Q @ np.diag(sigma) ** 2 @ Q.T
    back = decode_constraint(encode_constraint(Constraint(3, 17, np.array(z), R)))
    assert (back.first, back.second) == (3, 17)
    assert np.abs(back.z[:2] - z[:2]).max() <= 0.51 * POSE_STEP[0]
    floor = np.array([TUNING.least[0], TUNING.least[0], TUNING.least[1]]) ** 2
    assert (np.diag(back.R) >= np.maximum(np.diag(R), floor) * (1.0 - 1e-4)).all()
    assert np.linalg.eigvalsh(back.R)[0] > 0.0


@pytest.mark.parametrize('R', [1e9 * np.eye(3), np.array([[1.0, 5, 5], [5, 1, -5], [5, -5, 1]])])
def test_an_absurd_covariance_is_refused(R: Array) -> None:
    told = pack((1, 1)) + pack_scaled(np.zeros(3), POSE_STEP) + pack_covariance(R)
    with pytest.raises(ValueError, match='covariance'):
        decode_constraint(told)


@given(st.lists(st.integers(-2 ** 50, 2 ** 50), max_size=20), st.binary(max_size=9))
def test_numbers_come_through(numbers: list[int], rest: bytes) -> None:
    assert unpack(pack(numbers) + rest, len(numbers)) == (numbers, rest)
    if numbers:
        with pytest.raises(ValueError, match='cut short'):
            unpack(pack(numbers)[:-1], len(numbers))


def path(count: int = 6) -> Checkpoint:
    """Drive shortly through the fake room, with one loop."""
    poses = np.column_stack([np.linspace(1.0, 6.0, count), np.full(count, 1.5), np.zeros(count)])
    R = np.diag([0.01, 0.01, 0.005]) ** 2
    steps = [Constraint(k, k + 1, poses[k + 1] - poses[k], R) for k in range(count - 1)]
    scans = [MapScan(k, np.array([x, 0.0, 0.0]), seen_from(poses[k] + (x, 0.0, 0.0)).outline)
             for k in range(count) for x in (0.1, 0.25, 0.3, 0.5)]
    trail = [(k + x, k, x, 0.0, 0.0) for k in range(count) for x in (0.0, 0.1, 0.25, 0.3, 0.5)]
    return checkpoint(np.arange(count), poses, [seen_from(p) for p in poses],
                      [*steps, Constraint(0, count - 1, poses[-1] - poses[0], R)], scans, trail)


def test_a_path_comes_through_whole() -> None:
    whole = path()
    views = heard(tell(whole))
    assert views.stamps.tolist() == whole.stamps.tolist()
    assert views.poses == pytest.approx(whole.poses, abs=1e-6)
    assert [(r.first, r.second) for r in [*views.steps, *views.loops]] == [
        (r.first, r.second) for r in whole.constraints]
    assert [(scan.view, scan.stamp) for scan in views.between] == [
        (k, k + x) for k in range(6) for x in (0.25, 0.5)]        # spaced by 0.2 m


def test_nothing_is_told_twice_and_nothing_left_out() -> None:
    whole, teller = path(), Teller()
    part = replace(whole, poses=whole.poses[:3], stamps=whole.stamps[:3], clouds=whole.clouds[:3],
                   constraints=whole.constraints[:2], scans=whole.scans[:12],
                   trail=whole.trail[:15])
    first, second, third = teller.more(part), teller.more(whole), teller.more(whole)
    at_once = tell(whole)
    assert third.size == 0
    assert first.views + second.views == at_once.views
    assert first.loops + second.loops == at_once.loops
    assert first.between + second.between == at_once.between


def test_order_and_doubling_do_not_matter_and_what_follows_a_gap_waits() -> None:
    told = tell(path())
    mixed = heard(Facts(told.views[::-1] + told.views[2:4], told.loops))
    assert len(mixed) == 6
    with_gap = heard(Facts(told.views[:2] + told.views[3:], told.loops))
    assert len(with_gap) == 2
    assert [(r.first, r.second) for r in with_gap.steps] == [(0, 1)]


def test_a_view_that_follows_no_other_is_refused() -> None:
    wrong = ViewFact(4, 0.0, np.zeros(3), b'', Constraint(5, 4, np.zeros(3), np.eye(3)))
    with pytest.raises(ValueError, match='does not follow'):
        decode_view(wrong.encode())


@pytest.mark.parametrize('R', [np.zeros((3, 3)), np.diag([4e12, 4e12, 1.0])])
def test_a_constraint_of_the_robot_itself_is_always_one_that_is_believed(R: Array) -> None:
    back = decode_constraint(encode_constraint(Constraint(0, 1, np.zeros(3), R)))
    assert np.linalg.eigvalsh(back.R)[0] > 0.0
