# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a robot tells of its views comes through, and nothing else does harm."""

from dataclasses import replace

from helpers import checkpoint, fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial import cKDTree
from somfusion_ros.geometry import apply, Array, Pose
from somfusion_ros.slam.checkpoint import Checkpoint
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.free_space import Outline
from somfusion_ros.slam.map_scans import MapScan
from somfusion_ros.slam.scan import Cloud, cloud
from somfusion_ros.team.beam_code import decode_beams, encode_beams, MAX_BEAMS
from somfusion_ros.team.bit_code import deflate
from somfusion_ros.team.compact import pack, STEP as POSE_STEP, unpack
from somfusion_ros.team.fact import pack_facts, SCAN, unpack_facts
from somfusion_ros.team.outline_code import Corners, corners_of, follow
from somfusion_ros.team.outline_code import TUNING as OUTLINE
from somfusion_ros.team.shown import Shown
from somfusion_ros.team.teller import tell, Teller
from somfusion_ros.team.view_facts import (decode_constraint, decode_scan, decode_view,
                                           encode_constraint, encode_scan, Facts, heard, TUNING,
                                           ViewFact)
from somfusion_ros.team.view_set import DrawnScan
from somfusion_ros.team.view_store import decode_batch, encode_batches, ViewStore


def seen_from(pose: Array, twist: Array | None = None, sweep: float = 0.0, beams: int = 361,
              noise: float = 0.0) -> Cloud:
    """Scan the fake room, with noise [m], while the robot moves."""
    scan = fake_scan(fake_room(), pose, beams=beams, T_base_laser=Pose(0.1, -0.05, 0.3))
    scan = replace(scan, ranges=scan.ranges + noise * np.random.default_rng(0).normal(size=beams))
    return cloud(replace(scan, time_increment=sweep / beams), 20.0, twist)


def back(outline: Outline) -> Outline:
    """Return what a peer makes of what a robot tells of a scan."""
    return decode_beams(*encode_beams(outline)).outline


def batch_of(outline: Outline) -> bytes:
    """Pack a scan as a robot tells it."""
    return pack_facts([encode_scan(DrawnScan(1.0, 0, np.zeros(3), outline))])


@pytest.mark.slow
@given(x=st.floats(1.0, 6.5), y=st.floats(1.0, 2.4), theta=st.floats(-3.0, 3.0),
       speed=st.floats(-1.0, 1.0), turn=st.floats(-1.5, 1.5), beams=st.sampled_from([90, 361]),
       noise=st.sampled_from([0.0, 0.01, 0.03]))
@settings(max_examples=60, deadline=None)
def test_beams_come_through(x: float, y: float, theta: float, speed: float, turn: float,
                            beams: int, noise: float) -> None:
    seen = seen_from(np.array([x, y, theta]), np.array([speed, 0.0, turn]), 0.1, beams, noise)
    told = back(seen.outline)
    hit = seen.outline.hit
    assert np.array_equal(told.hit, hit)
    off = (told.ends - seen.outline.ends)[hit]
    nearest = cKDTree(told.hits).query(seen.outline.ends[hit])[0]
    assert nearest.max(initial=0.0) < OUTLINE.along + OUTLINE.step
    # Along a wall that beams graze: 0.153 m at (5.21875, 2, -2) with 90 beams.
    assert np.hypot(*off.T).max(initial=0.0) < 2.0 * OUTLINE.along + OUTLINE.step
    assert np.median(nearest) < OUTLINE.across
    assert np.abs(told.reach - seen.outline.reach)[~hit].max(initial=0.0) < 0.51 * OUTLINE.step
    assert np.allclose(told.origin, seen.outline.origin, atol=6e-5)


def test_a_wall_without_noise_is_two_corners() -> None:
    room = seen_from(np.array([2.0, 2.0, 1.0])).outline
    _, corners = encode_beams(room)
    assert len(corners.gaps) < 40       # 361 beams; the room has pillars


@given(st.lists(st.tuples(st.sampled_from('hod'), st.integers(1, 9), st.floats(0.1, 199.0)),
                max_size=12))
@settings(max_examples=60, deadline=None)
def test_pieces_of_any_kind_come_through(pieces: list[tuple[str, int, float]]) -> None:
    kinds = np.array([kind for kind, size, _ in pieces for _ in range(size)], str)
    reach = np.array([0.0 if kind == 'd' else far for kind, size, far in pieces
                      for _ in range(size)])
    outline = Outline(np.zeros((len(reach), 2)), reach, kinds == 'h')
    gaps, values = corners_of(outline, 0.01)
    again, hit = follow(Corners(gaps, values), len(reach), 0.01)
    assert np.array_equal(hit, kinds == 'h')
    assert np.array_equal(again > 0.0, reach > 0.0)
    assert np.abs(again - outline.reach)[kinds == 'o'].max(initial=0.0) <= 0.51 * OUTLINE.step
    assert np.abs(again - reach).max(initial=0.0) <= OUTLINE.along + OUTLINE.step


def test_a_return_that_is_too_far_to_be_told_is_none() -> None:
    outline = Outline(np.zeros((3, 2)), np.array([1.0, 900.0, 1.0]), np.ones(3, bool))
    reach, hit = follow(corners_of(outline, 0.01), 3, 0.01)
    assert hit.tolist() == [True, False, True]
    assert reach[1] > 100.0


def test_a_view_costs_few_bytes() -> None:
    sizes = [len(batch_of(seen_from(np.array([x, 1.5, x]), noise=0.01).outline))
             for x in np.linspace(1.0, 6.5, 20)]
    assert 40 < np.mean(sizes) < 200     # 361 beams of a room with pillars


def test_what_is_told_twice_is_the_same() -> None:
    """A robot uses its own facts as its peers do: packing what was unpacked changes nothing."""
    told = encode_beams(seen_from(np.array([2.0, 2.0, 1.0])).outline)
    assert np.array_equal(decode_beams(*told).points, decode_beams(*told).points)


@given(cut=st.integers(0, 400))
@settings(max_examples=40, deadline=None)
def test_facts_that_are_cut_short_are_refused(cut: int) -> None:
    told = batch_of(seen_from(np.array([2.0, 2.0, 1.0])).outline)
    if cut < len(told):
        with pytest.raises(ValueError, match='views|cut|fit|decompressed'):
            unpack_facts(told[:cut])


@given(noise=st.binary(min_size=0, max_size=200), at=st.integers(0, 300), bit=st.integers(0, 7))
@settings(max_examples=150, deadline=None)
def test_garbage_ends_in_a_value_error_or_a_small_view(noise: bytes, at: int, bit: int) -> None:
    told = bytearray(batch_of(seen_from(np.array([2.0, 2.0, 1.0])).outline))
    told[at % len(told)] ^= 1 << bit
    for data in (noise, bytes(told), bytes(told) + noise):
        try:
            seen = [decode_scan(fact) for fact in unpack_facts(data) if fact.kind == SCAN]
        except ValueError as error:
            assert '\n' not in str(error)
            continue
        for scan in seen:
            assert len(scan.outline.reach) <= MAX_BEAMS
            assert np.isfinite(scan.outline.ends).all()


def test_a_bomb_is_refused() -> None:
    bomb = pack([1, SCAN, 1, 5]) + deflate(bytes(50_000_000))
    with pytest.raises(ValueError, match='does not fit'):
        unpack_facts(bomb)
    for many in ([1, SCAN, 10 ** 8, 5], [1, SCAN, 1, 10 ** 9], [10 ** 9], [1, 77, 1, 0]):
        with pytest.raises(ValueError, match='views|cut short'):
            unpack_facts(pack(many))


def test_another_version_is_refused_by_name() -> None:
    batch, = encode_batches(Epoch('a1'), 't', tell(path(2)))
    with pytest.raises(ValueError, match='of version 2, not 3'):
        decode_batch(b'\x02' + batch[1:])


def test_what_is_told_at_once_comes_in_messages_of_bounded_size() -> None:
    many = Facts(loops=tuple(encode_constraint(Constraint(0, k, np.zeros(3), np.eye(3)))
                             for k in range(1, 1000)))
    batches = encode_batches(Epoch('a1'), 't', many)
    assert len(batches) == 4
    assert [fact for batch in batches for fact in decode_batch(batch)[2]] == [*many.loops]
    assert encode_batches(Epoch('a1'), 't', Facts()) == []


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
    assert (np.diag(back.R) >= 0.85 * np.maximum(np.diag(R), floor)).all()
    assert np.linalg.eigvalsh(back.R)[0] > 0.0
    for u in (*Q.T, *np.eye(3)):      # what is known well stays so, what is not, too
        told, came = u @ R @ u, u @ back.R @ u
        assert 0.85 * told <= came <= 1.25 * told + floor.sum() + 3e-6 * np.diag(back.R).max()


@pytest.mark.parametrize('R', [(767, 767, 767, 0, 0, 0), (-1, 0, 0, 0, 0, 0),
                               (99, 99, 99, 1 << 25, 0, 0), (769, 0, 0, 0, 0, 0)])
def test_an_absurd_covariance_is_refused(R: tuple[int, ...]) -> None:
    told = encode_constraint(Constraint(0, 1, np.zeros(3), np.eye(3)))
    with pytest.raises(ValueError, match='covariance'):
        decode_constraint(told._replace(numbers=(*told.numbers[:5], *R)))


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
    assert views.poses == pytest.approx(whole.poses, abs=1e-4)
    assert [(r.first, r.second) for r in [*views.steps, *views.loops]] == [
        (r.first, r.second) for r in whole.constraints]
    told = {(scan.view, scan.stamp) for scan in views.between}
    assert {(0, 0.25)} <= told < {(k, k + x) for k in range(6) for x in (0.25, 0.3, 0.5)}
    assert not any((k, k + 0.25) in told and (k, k + 0.3) in told for k in range(6))


def test_a_scan_is_told_only_where_it_shows_something_new() -> None:
    whole = path()
    poses = [*whole.poses, *(whole.poses[scan.view] + scan.T_view_base for scan in whole.scans)]
    saw = [*(c.outline for c in whole.clouds), *(scan.outline for scan in whole.scans)]
    views = heard(tell(whole))
    showed = [apply(pose, cloud.outline.hits) for pose, cloud in zip(whole.poses, views.clouds)]
    showed += [apply(whole.poses[s.view] + s.T_view_base, s.outline.hits) for s in views.between]
    missed = cKDTree(np.concatenate(showed)).query(np.concatenate([
        apply(pose, outline.hits) for pose, outline in zip(poses, saw)]))[0] > 0.15
    assert missed.mean() < 0.01
    again = Shown()
    for pose, outline in [*zip(poses, saw)] * 2:
        again.add(outline, pose)
    assert not any(again.is_new(outline, pose) for pose, outline in zip(poses, saw))
    assert again.is_new(saw[0], np.array([1e7, 0.0, 0.0]))      # where no raster reaches
    assert again.is_new(saw[0], poses[0] + (30.0, -40.0, 0.0))


def test_nothing_is_told_twice_and_nothing_left_out() -> None:
    whole, teller = path(), Teller()
    part = replace(whole, poses=whole.poses[:3], stamps=whole.stamps[:3], clouds=whole.clouds[:3],
                   constraints=whole.constraints[:2], scans=whole.scans[:12],
                   trail=whole.trail[:15])
    first, second, third = teller.more(part), teller.more(whole), teller.more(whole)
    at_once = tell(whole)
    assert third.every == ()
    assert first.views + second.views == at_once.views
    assert first.loops + second.loops == at_once.loops
    between = first.between + second.between
    assert len(set(between)) == len(between) >= len(at_once.between)


def test_views_between_two_that_were_taken_back_stay() -> None:
    """The path of a robot that was carried away twice, told anew after a restart."""
    whole, teller, store = path(), Teller(), ViewStore()
    nothing = Cloud(np.zeros((0, 2)), np.zeros((0, 2)))
    shown = replace(whole, clouds=[nothing if k in (1, 4) else cloud
                                   for k, cloud in enumerate(whole.clouds)])
    told = [batch for facts in (teller.more(shown), teller.more(shown), teller.more(shown))
            for batch in encode_batches(Epoch('1f'), 't', facts)]
    for batch in told:
        store.take(batch)
    assert [len(cloud.points) > 0 for cloud in store.views().clouds] == [
        True, False, True, True, False, True]
    views = store.views()
    for batch in told:
        store.take(batch)
    assert store.views() is views     # what comes again changes nothing


def test_a_long_path_is_told_a_few_views_at_a_time() -> None:
    """A robot that goes on with a long map does not keep its services waiting."""
    whole, teller, parts = path(), Teller(), list[Facts]()
    while teller.views < len(whole.clouds):
        parts.append(teller.more(whole, most=2))
    at_once = tell(whole)
    assert [len(part.views) for part in parts] == [2] * (len(whole.clouds) // 2)
    assert sum((part.views for part in parts), ()) == at_once.views
    assert sum((part.loops for part in parts), ()) == at_once.loops
    assert len(sum((part.between for part in parts), ())) >= len(at_once.between)
    assert teller.more(whole, most=2).every == ()


def test_order_and_doubling_do_not_matter_and_what_follows_a_gap_waits() -> None:
    told = tell(path())
    mixed = heard(Facts(told.views[::-1] + told.views[2:4], told.loops))
    assert len(mixed) == 6
    with_gap = heard(Facts(told.views[:2] + told.views[3:], told.loops))
    assert len(with_gap) == 2
    assert [(r.first, r.second) for r in with_gap.steps] == [(0, 1)]


def test_a_view_that_follows_no_other_is_refused() -> None:
    wrong = ViewFact(4, 0.0, np.zeros(3), Constraint(5, 4, np.zeros(3), np.eye(3)),
                     encode_beams(Outline())[0], b'')
    with pytest.raises(ValueError, match='does not follow'):
        decode_view(wrong.encode())


@pytest.mark.parametrize('R', [np.zeros((3, 3)), np.diag([4e12, 4e12, 1.0])])
def test_a_constraint_of_the_robot_itself_is_always_one_that_is_believed(R: Array) -> None:
    back = decode_constraint(encode_constraint(Constraint(0, 1, np.zeros(3), R)))
    assert np.linalg.eigvalsh(back.R)[0] > 0.0
