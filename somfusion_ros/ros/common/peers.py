# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which robots there are, told by the topics of the ROS graph."""

from collections.abc import Iterable
from contextlib import suppress

from somfusion_ros.ros.common import names
from somfusion_ros.team.names import robot_name


def find_peers(topics: Iterable[tuple[str, list[str]]], last_name: str, kind: str,
               own_topic: str, wanted: Iterable[str]) -> list[str]:
    """
    Return the names of the robots that publish a topic, which is `<robot>/<last name>`.

    Only topics of the exact type and last name count: never a peer's global_map or a costmap, nor
    what one robot shows of another below `peers`.

    Parameters
    ----------
    topics : names and types of all topics in the graph
    last_name : what follows the robot's name
    kind : type of the topic
    own_topic : the robot's own topic in full
    wanted : names to keep; none keeps all
    """
    wanted = {name.strip('/') for name in wanted if name.strip('/')}
    found = set()
    for topic, types in topics:
        name = topic.removesuffix(f'/{last_name}')
        if (name in (topic, '') or kind not in types or topic == own_topic
                or names.PEERS in name.strip('/').split('/')[1:]):
            continue
        with suppress(ValueError):
            found.add(robot_name(name.strip('/')))
    return sorted(found & wanted if wanted else found)


def find_robots(topics: Iterable[tuple[str, list[str]]], last_name: str, kind: str) -> list[str]:
    """Return the namespaces in which a topic is published, as find_peers does, and '' for none."""
    topics = list(topics)
    root = any(topic == f'/{last_name}' and kind in types for topic, types in topics)
    return [*([''] if root else []), *find_peers(topics, last_name, kind, '', ())]


def robot_of(frame: str) -> str:
    """Name of the robot to which a map frame `<robot>/map` belongs."""
    return frame.strip('/').rpartition('/')[0]
