# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The map of a robot that is gone, as another one hands it on."""

from somfusion_ros.team.map_codec import KEY, number_of


def lent_map(message: bytes) -> bytes:
    """
    Return the message of a lent map; ValueError where it claims to be the robot's own.

    Only a robot itself numbers its maps, and tells changes. With a number, what others lend would
    be taken unexamined, and be newer than all that the robot says when it is back.
    """
    if not message.startswith(KEY) or number_of(message):
        raise ValueError('a map that others lend is none of the messages that the robot numbers')
    return message
