# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a peer has seen is published when it changed and somebody looks, in the peer's frame."""

from types import SimpleNamespace
from typing import Any

from helpers import fake_grid, fake_room, need_ros
import numpy as np

need_ros()

from builtin_interfaces.msg import Time  # noqa: E402, I100
from somfusion_ros.geometry import Pose  # noqa: E402
from somfusion_ros.ros.fusion.frames import Frames  # noqa: E402
from somfusion_ros.ros.fusion.peer_topics import PeerTopics  # noqa: E402
from somfusion_ros.team.heard import Heard, TimedPose, TRAIL_KEPT  # noqa: E402
from somfusion_ros.team.shared_map import SharedMap  # noqa: E402


class Publisher:
    """Keeps what is published; somebody looks, or nobody."""

    def __init__(self) -> None:
        self.lookers, self.messages = 0, []   # type: int, list[Any]

    def get_subscription_count(self) -> int:
        """Tell how many look."""
        return self.lookers

    def publish(self, message: Any) -> None:
        """Keep a message."""
        self.messages.append(message)


def test_a_peer_is_shown_to_those_who_look_as_it_changes() -> None:
    made: dict[str, Publisher] = {}
    gone: list[Publisher] = []
    clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))
    node = SimpleNamespace(create_publisher=lambda kind, name, profile: made.setdefault(
        name, Publisher()), get_clock=lambda: clock, destroy_publisher=gone.append)
    maps = {'robot2': SharedMap(fake_grid(fake_room()))}
    session = SimpleNamespace(shown_maps=lambda: maps)
    heard = {'robot2': Heard()}
    topics = PeerTopics(node, Frames('robot1', 'map', 'world'), session, heard)
    topics.offer(['robot1', 'robot2'])
    assert set(made) == {f'peers/robot2/{name}' for name in ('map', 'path', 'clusters')}
    shown, path = made['peers/robot2/map'], made['peers/robot2/path']

    topics.publish()
    assert not shown.messages   # nobody looks
    shown.lookers = path.lookers = 1
    for _ in range(3):
        topics.publish()
    assert len(shown.messages) == 1
    assert shown.messages[0].header.frame_id == 'robot2/map'
    shown.lookers = 2   # one more
    topics.publish()
    assert len(shown.messages) == 2
    maps['robot2'] = SharedMap(fake_grid(fake_room(9.0)))
    topics.publish()
    assert len(shown.messages) == 3
    assert not path.messages   # nothing is known of its way
    for step in range(TRAIL_KEPT + 3):   # more than are kept
        heard['robot2'].add_pose(TimedPose(float(step), Pose(0.2 * step), np.eye(3)))
        if step >= TRAIL_KEPT:
            topics.publish()
            topics.publish()
            assert len(path.messages) == step + 1 - TRAIL_KEPT
    last = path.messages[-1].poses[-1]
    assert last.header.frame_id == 'robot2/map'
    assert last.pose.position.x == heard['robot2'].trail[-1][0]

    told = len(shown.messages)
    topics.offer(['robot1'])     # it is connected no more: its frame is in no tree
    assert set(gone) == set(made.values())
    topics.publish()
    assert len(shown.messages) == told
    topics.offer(['robot1', 'robot2'])
    topics.publish()
    assert len(shown.messages) == told + 1, 'whoever still looks gets the map again'
