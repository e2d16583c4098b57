# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of the frames and topics of every robot, as one robot sees them."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Frames:
    """
    The tree of one robot.

    robot: its own name; own: the frame of its own map; world: the frame of the team. An own frame
    with a prefix, such as robot1/map, means that all robots share one /tf.
    """

    robot: str
    own: str
    world: str

    @property
    def shared(self) -> bool:
        """Whether all robots share one /tf."""
        return '/' in self.own.strip('/')

    def map_of(self, robot: str) -> str:
        """Name of a robot's map frame in this tree."""
        return self.own if robot == self.robot else f'{robot}/{self.own.rpartition("/")[2]}'


def team_prefix(namespace: str, robot: str) -> str:
    """
    Return where the topics for the team stand: in the namespace, or below the name in the root.

    The other robots find a robot by the first part of its topics, so that is its name. ValueError
    where a robot cannot be found under the name that it gives itself.
    """
    namespace = namespace.strip('/')
    if not robot:
        raise ValueError('fusion_node in the root namespace cannot tell its robot from the '
                         'others: start it in a namespace (--ros-args -r __ns:=/robot1) or '
                         'set the parameter robot_name')
    if namespace and namespace != robot:
        raise ValueError(f'robot_name is {robot!r}, but the namespace is /{namespace}: the others '
                         f'would find this robot as {namespace!r}. Leave robot_name empty, or '
                         'start the node in the root namespace')
    return '' if namespace else f'/{robot}/'
