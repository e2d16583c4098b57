# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A replay's bag holds what happened over time, in one tree of frames that hangs together."""

from collections import defaultdict
from pathlib import Path
from typing import Any

from helpers import write_fake_bag
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from somfusion_ros.geometry import compose
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.io.frame_tree import yaw
from somfusion_ros.offline.history import History
from somfusion_ros.offline.replay import replay, ReplayOptions
from somfusion_ros.offline.result_bag import shifts_of
from somfusion_ros.offline.robot_run import run_robot

pytestmark = pytest.mark.slow
WAY = np.array([(1.0, 1.0), (4.0, 1.2), (6.5, 2.6), (4.0, 3.2), (1.5, 4.5), (1.0, 1.0),
                (4.0, 1.2)])


@pytest.fixture(scope='module')
def replayed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Any]]]:
    """Replay two robots; give the folder and (stamp of recording [s], message) by topic."""
    folder = tmp_path_factory.mktemp('replay')
    write_fake_bag(folder / 'a', waypoints=WAY)
    write_fake_bag(folder / 'b', waypoints=WAY[::-1], start=9000.0)
    replay([folder / 'a', folder / 'b'], folder / 'out', ReplayOptions(bag=True, pictures=False))
    messages = defaultdict(list)
    with AnyReader([folder / 'out' / 'bag']) as reader:
        for connection, stamp, raw in reader.messages():
            messages[connection.topic].append(
                (stamp * 1e-9, reader.deserialize(raw, connection.msgtype)))
    return folder / 'out', messages


def test_every_topic_is_there_and_grows_over_time(replayed: Any) -> None:
    _, messages = replayed
    assert set(messages) == {'/tf', '/tf_static', '/global_map'} | {
        f'/{robot}/{topic}' for robot in ('robot1', 'robot2')
        for topic in ('map', 'pose', 'path', 'clusters')}
    for robot in ('robot1', 'robot2'):
        known = [int((m.data >= 0).sum()) for _, m in messages[f'/{robot}/map']]
        assert len(known) >= 5
        assert known[-1] > 1.2 * known[0]
        paths = [len(m.poses) for _, m in messages[f'/{robot}/path']]
        assert paths == sorted(paths)
        clouds = [m for _, m in messages[f'/{robot}/clusters']]
        assert clouds[-1].width > 20
        assert len(clouds[-1].data) == clouds[-1].row_step


def test_maps_drawn_on_the_way_do_not_change_the_last_one(replayed: Any) -> None:
    out, _ = replayed
    log = open_log(out.parent / 'a')
    history = History(2.0)
    told, alone = run_robot(log, history=history), run_robot(log)
    assert len(history.maps) > 5
    assert np.array_equal(told.grid.evidence, alone.grid.evidence)
    assert np.array_equal(history.maps[-1][1].evidence, alone.grid.evidence)


def test_logs_of_different_days_are_told_side_by_side(replayed: Any) -> None:
    _, messages = replayed
    starts = [messages[f'/{robot}/pose'][0][0] for robot in ('robot1', 'robot2')]
    assert starts[0] == pytest.approx(starts[1], abs=0.5)
    assert shifts_of({'a': (5.0, 9.0), 'b': (8.0, 12.0)}) == {'a': 0.0, 'b': 0.0}
    assert shifts_of({'a': (5.0, 9.0), 'b': (20.0, 30.0)}) == {'a': 0.0, 'b': -15.0}


def test_the_tree_of_frames_places_every_robot_as_its_pose_says(replayed: Any) -> None:
    _, messages = replayed
    found = {}
    for _, message in messages['/tf'] + messages['/tf_static']:
        for item in message.transforms:
            t = item.transform
            found[item.header.frame_id, item.child_frame_id] = (
                t.translation.x, t.translation.y, yaw(t.rotation))
    for robot in ('robot1', 'robot2'):
        by_tf = compose(found[f'{robot}/map', f'{robot}/odom'],
                        found[f'{robot}/odom', f'{robot}/base_link'])
        last = messages[f'/{robot}/pose'][-1][1].pose.pose
        assert np.allclose(by_tf, (last.position.x, last.position.y, yaw(last.orientation)),
                           atol=1e-6)
        assert (f'{robot}/base_link', f'{robot}/laser') in found
        assert ('world', f'{robot}/map') in found   # both rooms are one


def test_the_last_global_map_is_that_of_the_result(replayed: Any) -> None:
    folder, messages = replayed
    stamp, last = messages['/global_map'][-1]
    assert last.header.frame_id == 'world'
    assert (folder / 'map.pgm').exists()
    height, width = (int(side) for side in
                     (folder / 'map.pgm').read_bytes().split(b'\n')[1].split()[::-1])
    assert (last.info.width, last.info.height) == (width, height)
