# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Who is listened to: everybody, up to a number, and who is gone makes room for who comes."""

from types import SimpleNamespace
from typing import Any

from helpers import need_ros

need_ros()

from somfusion_ros.fusion.config import FusionConfig  # noqa: E402
from somfusion_ros.node_config import FusionNodeConfig  # noqa: E402
from somfusion_ros.ros.common.names import (MAP_TYPE, STATE_TYPE, TEAM_DEPARTED,  # noqa: E402
                                            TEAM_DEPARTED_VIEWS, TEAM_STATE)
from somfusion_ros.ros.fusion.departed_link import DepartedLink  # noqa: E402
from somfusion_ros.ros.fusion.discovery import Discovery, MOST_PEERS  # noqa: E402
from somfusion_ros.ros.fusion.receiver import Receiver  # noqa: E402
from somfusion_ros.ros.fusion.team_link import TeamLink  # noqa: E402
from somfusion_ros.team.config import TeamConfig  # noqa: E402
from somfusion_ros.team.heard import Heard  # noqa: E402
from somfusion_ros.team.inbox import Inbox  # noqa: E402
from somfusion_ros.team.session import FusionSession  # noqa: E402
from somfusion_ros.team.sightings import Sightings  # noqa: E402
from std_msgs.msg import UInt8MultiArray  # noqa: E402


class FakeNode:
    """A node in a graph of topics that a test writes down."""

    def __init__(self) -> None:
        self.robots: set[str] = set()
        self.subscriptions: list[str] = []

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        """Return the states of all robots."""
        return [(f'/{robot}/{TEAM_STATE}', [STATE_TYPE]) for robot in sorted(self.robots)]

    def count_publishers(self, topic: str) -> int:
        """Return whether the robot of a state is there."""
        return int(topic.strip('/').removesuffix(f'/{TEAM_STATE}') in self.robots)

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        """Return nobody: no plain map is published."""
        return []

    def create_publisher(self, *_: Any) -> Any:
        """Make a publisher to which nobody listens."""
        return SimpleNamespace(publish=lambda message: None)

    def create_subscription(self, kind: type, topic: str, *_: Any) -> str:
        """Note a subscription."""
        self.subscriptions.append(topic)
        return topic

    def destroy_subscription(self, topic: str) -> None:
        """Forget a subscription."""
        self.subscriptions.remove(topic)

    def resolve_topic_name(self, name: str) -> str:
        """Return a name below the robot's own."""
        return f'/robot1/{name}'

    def get_logger(self) -> Any:
        """Return a log that nobody reads."""
        return SimpleNamespace(info=lambda text: None)


def a_discovery() -> tuple[FakeNode, Discovery]:
    """Make what robot1 finds the others with."""
    node, session = FakeNode(), FusionSession('robot1', TeamConfig(), FusionConfig(),
                                              lambda text: None)
    inbox = Inbox('robot1', session, 10 ** 6, lambda *_: None, lambda: 0.0)
    inbox.heard['robot1'] = Heard()
    receiver = Receiver(inbox, Sightings('robot1', inbox.heard, session.take_sighting,
                                         lambda *_: None), 10 ** 6, lambda *_: None)
    link = TeamLink(node, '', receiver, lambda *_: None)
    return node, Discovery(node, '', FusionNodeConfig(), link, receiver)


def test_64_names_that_come_and_go_leave_room_for_the_65th() -> None:
    node, discovery = a_discovery()
    for number in range(5 * MOST_PEERS):
        node.robots = {f'liar{number}'}
        discovery.look()
        discovery.look()
        assert f'/liar{number}/{TEAM_STATE}' in node.subscriptions
    node.robots = {'robot2'}
    discovery.look()
    assert discovery.teams >= {'robot2'}
    assert f'/robot2/{TEAM_STATE}' in node.subscriptions
    assert len(node.subscriptions) <= 1 + 5 * MOST_PEERS   # a few of each robot, and the own state
    assert len(discovery.teams) <= MOST_PEERS


def test_who_is_there_is_not_put_out_by_new_names() -> None:
    node, discovery = a_discovery()
    node.robots = {f'robot{number}' for number in range(2, 2 + MOST_PEERS)}
    discovery.look()
    before = set(discovery.teams)
    node.robots |= {f'new{number}' for number in range(10)}
    discovery.look()
    assert discovery.teams == before
    node.robots.discard('robot2')
    discovery.look()
    discovery.look()
    assert len(discovery.teams - before) == 1


def test_views_of_a_robot_that_is_gone_are_waited_for_though_its_map_has_come() -> None:
    """They are larger than the map, and are told once."""
    node, kept = FakeNode(), []
    receiver = SimpleNamespace(inbox=SimpleNamespace(heard={}), on_lent_map=print)
    link = DepartedLink(node, '', receiver, SimpleNamespace(),
                        SimpleNamespace(keep_kept=lambda *of: kept.append(of)))
    link.fetch({'robot3': 'robot2'}, {'robot3'})
    there = [f'/robot2/{topic}/robot3' for topic in (TEAM_DEPARTED, TEAM_DEPARTED_VIEWS)]
    assert node.subscriptions == there
    link.fetch({}, {'robot3'})
    assert node.subscriptions == there
    link._on_views('robot3', UInt8MultiArray(data=b'views'))
    link.fetch({}, {'robot3'})
    assert (node.subscriptions, kept) == ([], [('robot3', b'views')])
    link.fetch({'robot3': 'robot2'}, {'robot3'})
    link.fetch({}, set())      # it is back
    assert node.subscriptions == []


def test_a_robot_without_a_fusion_node_is_heard_again_after_a_deactivation() -> None:
    """The inbox, which outlives the subscriptions, knows it; that is no reason not to listen."""
    node, discovery = a_discovery()
    again = Discovery(node, '', FusionNodeConfig(plain_map_delay=0.0), discovery._link,
                      discovery._receiver)
    node.get_topic_names_and_types = lambda: [('/robot2/map', [MAP_TYPE])]
    discovery._heard['robot2'] = Heard()
    for _ in range(2):
        again.look()
    assert node.subscriptions.count('/robot2/map') == 1
