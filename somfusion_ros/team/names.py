# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of robots, which become parts of topic names, frame names, file names and log lines."""

import re

LONGEST = 64     # letters of a robot's name
# A ROS 2 namespace without its first slash: words of letters, digits and underscores.
NAME = re.compile(r'[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*')


def robot_name(value: object) -> str:
    """Return the name of a robot; ValueError on what ROS 2 does not take as a namespace."""
    if not isinstance(value, str) or len(value) > LONGEST or '__' in value or (
            NAME.fullmatch(value) is None):
        raise ValueError(f'{str(value)[:20]!a} is no name of a robot: ROS 2 takes letters, '
                         f'digits, underscores and slashes, {LONGEST} of them at most')
    return value
