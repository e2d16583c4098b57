# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Messages that are wrong in every way: refused with a sentence, in bounded time and memory."""

from array import array
from collections.abc import Callable
from functools import partial
import time
import tracemalloc
from typing import Any

from helpers import cut_grid, fake_grid, fake_room, furnished_room, need_ros, pose_error
import numpy as np
import pytest

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from geometry_msgs.msg import PoseWithCovarianceStamped, Quaternion, TransformStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402
from sensor_msgs.msg import JointState, LaserScan, PointCloud2, PointField  # noqa: E402
from somfusion_ros.fusion.config import FusionConfig  # noqa: E402
from somfusion_ros.geometry import Pose  # noqa: E402
from somfusion_ros.io.frame_tree import Mount  # noqa: E402
from somfusion_ros.ros.common import conversions as convert  # noqa: E402
from somfusion_ros.ros.fusion.receiver import Receiver  # noqa: E402
from somfusion_ros.ros.fusion.team_messages import (bytes_from_message,  # noqa: E402
                                                    bytes_message, clusters_from_message)
from somfusion_ros.slam.epoch import Epoch  # noqa: E402
from somfusion_ros.team.channels import CHANGES, MAP  # noqa: E402
from somfusion_ros.team.config import TeamConfig  # noqa: E402
from somfusion_ros.team.constraint import MapConstraint  # noqa: E402
from somfusion_ros.team.heard import Heard  # noqa: E402
from somfusion_ros.team.inbox import Inbox  # noqa: E402
from somfusion_ros.team.map_codec import MapDecoder, MapEncoder  # noqa: E402
from somfusion_ros.team.session import FusionSession  # noqa: E402
from somfusion_ros.team.shared_map import MapCells, SharedMap  # noqa: E402
from somfusion_ros.team.sightings import Sightings  # noqa: E402
from somfusion_ros.team.state_codec import decode_state, encode_state, TeamState  # noqa: E402
from std_msgs.msg import String  # noqa: E402

MESSAGES = 20000
MEGABYTE = 2 ** 20
LIMIT = 10 ** 6
FLOATS = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-9, -0.05, 1e-300, 1e300, 1e38, 1.0, 0.05,
                   -3.0, 1e6, 100.0])
COUNTS = np.array([0, 1, 2, 7, 100, 10 ** 6, 2 ** 31, 2 ** 32 - 1])
ROOM = fake_grid(fake_room())
CELLS = MapCells(ROOM.to_occupancy(), ROOM.resolution, ROOM.T_frame_grid)
STREAM = MapEncoder()
STREAM.encode(CELLS)
GOOD_STATE = encode_state(TeamState('abc', (MapConstraint('a', 'b', Pose(1, 2, 3), np.eye(3)),)))


def number(rng: np.random.Generator) -> float:
    """Return a float, more often absurd than not."""
    return float(rng.choice(FLOATS)) if rng.random() < 0.7 else float(rng.normal())


def small(rng: np.random.Generator) -> float:
    """Return a float that fits into 32 bits."""
    return float(np.clip(number(rng), -3e38, 3e38)) if rng.random() < 0.9 else float('nan')


def some_bytes(rng: np.random.Generator, most: int = 400) -> bytes:
    """Return a few bytes."""
    return rng.integers(0, 256, rng.integers(0, most), dtype=np.uint8).tobytes()


def a_grid(rng: np.random.Generator) -> OccupancyGrid:
    """Make a map of any size, resolution and origin, with any data."""
    message = OccupancyGrid()
    height, width = rng.integers(0, 20, 2)
    if rng.random() < 0.4:
        height, width = rng.choice(COUNTS, 2)
    height, width = int(height), int(width)
    message.info.height, message.info.width = height, width
    message.info.resolution = small(rng)
    origin = message.info.origin
    origin.position.x, origin.position.y = number(rng), number(rng)
    origin.orientation = Quaternion(x=number(rng), y=number(rng), z=number(rng), w=number(rng))
    length = height * width if height * width < 1000 and rng.random() < 0.7 else 0
    message.data = array('b', rng.integers(-128, 128, length, dtype=np.int8).tobytes())
    return message


def a_pose(rng: np.random.Generator) -> PoseWithCovarianceStamped:
    """Make a pose with any numbers."""
    message = PoseWithCovarianceStamped()
    message.pose.pose = a_grid(rng).info.origin
    message.pose.covariance = np.array([number(rng) for _ in range(36)])
    return message


def a_transform(rng: np.random.Generator) -> TransformStamped:
    """Make a transform with any numbers."""
    message, pose = TransformStamped(child_frame_id='x' * rng.integers(9)), a_pose(rng).pose.pose
    message.transform.translation.x = pose.position.x
    message.transform.rotation = pose.orientation
    return message


def a_cloud(rng: np.random.Generator) -> PointCloud2:
    """Make a cloud, sometimes nearly one of clusters."""
    rows = rng.normal(size=(rng.integers(0, 9), 7)).astype(np.float32)
    rows.flat[:rng.integers(0, 3)] = small(rng)
    cloud = convert.cluster_cloud(rows, 'map', Time())
    if rng.random() < 0.7:
        cloud.width = int(rng.choice(COUNTS))
    if rng.random() < 0.3:
        cloud.point_step = int(rng.choice(COUNTS))
    if rng.random() < 0.3:
        cloud.data = array('B', some_bytes(rng))
    if rng.random() < 0.3:
        cloud.fields = [PointField(name='x')] * int(rng.integers(0, 9))
    return cloud


def a_state(rng: np.random.Generator) -> String:
    """Make a state with some letters changed, or none at all."""
    letters = list(GOOD_STATE)
    for _ in range(rng.integers(0, 4)):
        letters[rng.integers(len(letters))] = chr(rng.integers(32, 126))
    text = ''.join(letters)
    return String(data=rng.choice([text, text.replace('1.0', 'NaN'), '[' * 5000, '{}', '7',
                                   text.replace('"constraints": [', '"constraints": [[],'),
                                   text[:rng.integers(len(text))]]))


def a_stream(rng: np.random.Generator) -> Any:
    """Make bytes that are a map with some changed, or none."""
    data = bytearray(STREAM.key)
    for _ in range(rng.integers(1, 5)):
        data[rng.integers(rng.choice([90, len(data)]))] = rng.integers(256)
    return bytes_message(bytes(data) if rng.random() < 0.7 else some_bytes(rng))


def a_scan(rng: np.random.Generator) -> LaserScan:
    """Make a scan with any numbers."""
    return LaserScan(ranges=[small(rng) for _ in range(rng.integers(0, 9))],
                     angle_min=small(rng), angle_increment=small(rng), range_min=small(rng),
                     range_max=small(rng), time_increment=small(rng))


def an_odometry(rng: np.random.Generator) -> Odometry:
    """Make odometry with any numbers."""
    message = Odometry()
    message.pose = a_pose(rng).pose
    return message


def some_joints(rng: np.random.Generator) -> JointState:
    """Make joints with any names and numbers."""
    return JointState(name=[str(n) for n in rng.choice(['l', 'r', ''], rng.integers(0, 4))],
                      position=[number(rng) for _ in range(rng.integers(0, 4))])


DECODER = MapDecoder(LIMIT)
KINDS: dict[str, tuple[Callable[[np.random.Generator], Any], Callable[[Any], Any]]] = {
    'grid': (a_grid, lambda m: SharedMap.from_cells(convert.cells_from_message(m, LIMIT))),
    'plain grid': (a_grid, lambda m: convert.grid_from_message(m, LIMIT)),
    'pose': (a_pose, lambda m: convert.pose_from_message(m.pose.pose)),
    'covariance': (a_pose, lambda m: convert.usable_covariance(m.pose.covariance)),
    'transform': (a_transform, convert.transform_from_message),
    'clusters': (a_cloud, clusters_from_message),
    'state': (a_state, lambda m: decode_state(m.data)),
    'stream': (a_stream, lambda m: DECODER.decode(bytes_from_message(m))),
    'odometry': (an_odometry, convert.odometry_from_message),
    'joints': (some_joints, lambda m: convert.wheels_from_message(m, 'l', 'r'))}


@pytest.mark.parametrize('kind', KINDS)
def test_a_random_message_is_converted_or_refused_with_one_line(kind: str) -> None:
    make, use = KINDS[kind]
    rng, refused = np.random.default_rng(len(kind)), 0
    for _ in range(MESSAGES // len(KINDS)):
        try:
            use(make(rng))
        except ValueError as error:
            refused += 1
            assert str(error)
            assert '\n' not in str(error)
    assert refused > 0.1 * MESSAGES / len(KINDS)


def test_any_scan_is_taken_as_it_is() -> None:
    rng = np.random.default_rng(0)
    for _ in range(500):
        message = a_scan(rng)
        assert len(convert.scan_from_message(message, Mount(Pose())).ranges) == len(message.ranges)


def a_receiver(counts: list[str]) -> tuple[Receiver, FusionSession]:
    """Make what robot1's fusion node takes messages with, and give it a map."""
    session = FusionSession('robot1', TeamConfig(), FusionConfig(), lambda text: None)

    def count(kind: str, reason: str = '') -> None:
        counts.append(kind)
    inbox = Inbox('robot1', session, LIMIT, count, time.monotonic)
    receiver = Receiver(inbox, Sightings('robot1', inbox.heard, session.take_sighting, count),
                        LIMIT, count)
    inbox.heard |= {robot: Heard() for robot in ('robot1', 'robot2', 'robot9')}
    receiver.on_map('robot1', convert.grid_message(ROOM, 'map', Time()))
    inbox.drain()
    return receiver, session


def test_a_flood_of_garbage_is_counted_under_its_sender_and_fills_no_memory() -> None:
    counts: list[str] = []
    receiver, session = a_receiver(counts)
    rng = np.random.default_rng(1)
    kinds = ((receiver.on_map, a_grid), (partial(receiver.on_bytes, channel=MAP), a_stream),
             (partial(receiver.on_bytes, channel=CHANGES), a_stream), (receiver.on_state, a_state),
             (receiver.on_clusters, a_cloud))
    tracemalloc.start()
    for step in range(1000):
        take, make = kinds[step % len(kinds)]
        take('robot9', message=make(rng))
        receiver.on_pose('robot9', a_pose(rng))
        receiver.on_transform('robot9', a_transform(rng))
        if step % 20 == 0:
            receiver.inbox.drain()
            session.refresh()
        if step == 300:
            before = tracemalloc.get_traced_memory()[0]
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert len(counts) > 50
    assert all('robot9' in kind for kind in counts)
    assert grown < 5 * MEGABYTE


@pytest.mark.parametrize('resolution', [0.0, 1e-9, 1e9])
def test_absurd_resolutions_are_refused(resolution: float) -> None:
    with pytest.raises(ValueError, match='resolution'):
        SharedMap.from_cells(CELLS._replace(resolution=resolution))


def two_and_a_liar(pose: Pose, resolution: float = 0.05) -> tuple[FusionSession, list[str]]:
    """Join robot1 and robot2, and a robot9 that claims to lie at a pose."""
    said: list[str] = []
    session = FusionSession('robot1', TeamConfig(), FusionConfig(), said.append)
    walls = furnished_room()
    session.take_map('robot1', SharedMap(fake_grid(walls)))
    session.take_map('robot2', SharedMap(fake_grid(walls, T_map_walls=Pose(2.0, 1.0, 0.3))))
    session.take_map('robot9', SharedMap(fake_grid(fake_room(), resolution)))
    assert session.attempt(0.0) == 'robot2'
    session.take_state('robot9', TeamState('s', (
        MapConstraint('robot1', 'robot9', pose, 1e-9 * np.eye(3)),)))
    session.refresh()
    return session, said


def test_a_liar_far_away_is_left_out_and_the_global_map_stays() -> None:
    session, said = two_and_a_liar(Pose(9e4, 9e4, 0.0))
    merged = session.draw()
    assert merged is not None
    assert merged.evidence.size < 10 ** 6
    assert any('robot9 is left out' in text for text in said)


def test_a_liar_with_tiny_cells_does_not_make_the_global_map_tiny() -> None:
    session, _ = two_and_a_liar(Pose(30.0, 0.0, 0.0), 0.01)
    assert session.draw().resolution == 0.05


def test_a_liar_cannot_pull_two_others_apart() -> None:
    session, said = two_and_a_liar(Pose(5.0, 5.0, 1.0))
    truth = session.snapshot.world('robot1')['robot2']
    lies = [MapConstraint(f'robot{n}', 'robot9', Pose(5.0 * n, 5.0, float(n)), 1e-9 * np.eye(3))
            for n in (1, 2)]
    honest = MapConstraint('robot1', 'robot2', truth, 0.01 * np.eye(3), 0.9)
    session.take_state('robot2', TeamState('s', (honest,)))
    session.take_state('robot9', TeamState('s', tuple(lies * 20)))
    placed = session.refresh().world('robot1')
    assert pose_error(placed['robot2'], truth)[0] < 0.01
    assert any('robot9' in text and 'contradicts' in text for text in said)


def test_a_map_that_flips_between_two_buildings_is_tried_ever_more_rarely() -> None:
    said: list[str] = []
    session = FusionSession('robot1', TeamConfig(), FusionConfig(), said.append)
    walls = furnished_room()
    other = cut_grid(fake_grid(fake_room(5.0, 4.0)), (-1.0, -1.0), (4.0, 4.0))
    session.take_map('robot1', SharedMap(fake_grid(walls)))
    tried = []
    for second in range(400):
        grid = fake_grid(walls) if second // 2 % 2 else other
        session.begin('robot9', Epoch('2e', second // 2), float(second))
        session.take_map('robot9', SharedMap(grid))
        if session.attempt(float(second)):
            tried.append(second)
    assert len(tried) < 40
    assert sum(second > 200 for second in tried) < 8
    assert any('robot9 began another map' in text for text in said)
