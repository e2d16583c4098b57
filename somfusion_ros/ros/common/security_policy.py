# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Write the SROS2 policy of robots: what their nodes say and hear, and nothing else.

`python -m somfusion_ros.ros.common.security_policy robot1 robot2 > policy.xml` is what
`ros2 security create_permission` takes. A robot may hear whatever its peers' nodes say for the
team, under any name: who has no key says nothing.
"""

import argparse
from collections.abc import Iterator, Sequence
import sys
from typing import NamedTuple
import xml.etree.ElementTree as ET

from somfusion_ros.ros.common import names
from somfusion_ros.settings import NAMES

VERSION = '0.2.0'    # of the format, SROS2's of Jazzy
ANY = '*'            # a robot's name


class Interface(NamedTuple):
    """What one kind of node publishes, what it subscribes to, and which services it answers."""

    publish: tuple[str, ...]
    subscribe: tuple[str, ...]
    reply: tuple[str, ...]


# Of every managed node.
COMMON = Interface(
    ('/rosout', '/parameter_events', names.DIAGNOSTICS, '~/transition_event'),
    ('/parameter_events', '/clock'),
    tuple(f'~/{service}' for service in (
        'describe_parameters', 'get_parameter_types', 'get_parameters', 'list_parameters',
        'set_parameters', 'set_parameters_atomically', 'get_type_description', 'change_state',
        'get_state', 'get_available_states', 'get_available_transitions',
        'get_transition_graph')))
# Beside the robot's own tf; where it is not remapped, the one of all.
TRANSFORMS = names.TF.strip('/'), names.TF_STATIC.strip('/'), names.TF, names.TF_STATIC
NODES = {
    'slam_node': Interface(
        (names.MAP, names.MAP_GRADED, names.MAP_METADATA, names.ROBOT_POSE, names.PATH,
         names.MAP_EPOCH, names.VIEWS, *TRANSFORMS[::2]),
        (names.SCAN, names.ODOMETRY, names.JOINT_STATES, names.IMU, names.PEER_BODIES,
         names.JOINT_PATH, names.INITIAL_POSE, names.MAP, *TRANSFORMS),
        (names.SAVE_MAP, names.SAVE_MAP_AS, names.SERIALIZE_MAP, names.DESERIALIZE_MAP,
         names.RESET, names.PAUSE, names.DYNAMIC_MAP)),
    'fusion_node': Interface(
        (names.GLOBAL_MAP, names.GLOBAL_MAP_GRADED, names.RELATIVE_TRANSFORMS, names.PEER_BODIES,
         names.PEER_POSES, f'{names.PEER_POSES}/{ANY}', names.LOOKOUTS, names.CLUSTERS,
         names.MARKERS, names.JOINT_PATH, names.INITIAL_POSE, f'{names.PEERS}/{ANY}',
         names.TEAM_STATE, names.TEAM_POSE, names.TEAM_MAP, names.TEAM_MAP_CHANGES,
         names.TEAM_BONDS, f'{names.TEAM_DEPARTED}/{ANY}', f'{names.TEAM_DEPARTED_VIEWS}/{ANY}',
         *TRANSFORMS[::2]),
        (names.MAP, names.MAP_GRADED, names.MAP_EPOCH, names.ROBOT_POSE, names.PATH, names.VIEWS,
         names.ENCOUNTERS, names.INITIAL_POSE, names.TEAM_STATE,
         *(f'/{ANY}/{topic}' for topic in (
             names.TEAM_STATE, names.TEAM_POSE, names.TEAM_MAP, names.TEAM_MAP_CHANGES,
             names.TEAM_BONDS, names.CLUSTERS, names.VIEWS, f'{names.TEAM_DEPARTED}/{ANY}',
             f'{names.TEAM_DEPARTED_VIEWS}/{ANY}', names.MAP, names.ROBOT_POSE,
             names.RELATIVE_TRANSFORMS, names.MAP_EPOCH))),
        (names.MERGE, names.SAVE_MAP, names.SAVE_MAP_AS, names.RESET)),
}


def allowed(robot: str, node: str) -> Interface:
    """Return what a node of a robot may say, hear and answer, by absolute names."""
    return Interface(*(tuple(sorted({_absolute(name, robot, node) for name in (*common, *own)}))
                       for common, own in zip(COMMON, NODES[node])))


def _absolute(name: str, robot: str, node: str) -> str:
    """Resolve a name as ROS does."""
    if name.startswith('/'):
        return name
    return f'/{robot}/{node}{name[1:]}' if name.startswith('~') else f'/{robot}/{name}'


def policy(robots: Sequence[str]) -> str:
    """Return the policy of robots as XML, an enclave for each of their nodes."""
    root = ET.Element('policy', version=VERSION)
    enclaves = ET.SubElement(root, 'enclaves')
    for robot in robots:
        for node in NODES:
            enclave = ET.SubElement(enclaves, 'enclave', path=f'/{robot}/{node}')
            profile = ET.SubElement(ET.SubElement(enclave, 'profiles'), 'profile',
                                    ns=f'/{robot}', node=node)
            for group, item, rule, listed in _rules(allowed(robot, node)):
                parent = ET.SubElement(profile, group, {rule: 'ALLOW'})
                for name in listed:
                    ET.SubElement(parent, item).text = name
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _rules(interface: Interface) -> Iterator[tuple[str, str, str, tuple[str, ...]]]:
    """Yield the groups of a profile: tag, tag of its items, rule, names."""
    yield 'services', 'service', 'reply', interface.reply
    yield 'topics', 'topic', 'subscribe', interface.subscribe
    yield 'topics', 'topic', 'publish', interface.publish


def main(arguments: list[str] | None = None) -> None:
    """Write the policy of the robots that are named to the terminal."""
    parser = argparse.ArgumentParser(prog='security_policy', description=(
        "Write the SROS2 policy of robots' slam_node and fusion_node to standard output."))
    parser.add_argument('robots', metavar='ROBOT', nargs='+', help="the robot's namespace")
    robots = parser.parse_args(arguments).robots
    for robot in robots:
        if not NAMES['robot'].fullmatch(robot):
            parser.error(f'{robot!r} is no name of a robot: letters, digits, _ and /')
    sys.stdout.write(policy([robot.strip('/') for robot in robots]))


if __name__ == '__main__':
    main()
