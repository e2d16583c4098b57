# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Names of frames, with the prefixes of several robots, as one tree or as many spell them."""

from collections.abc import Iterable
from difflib import SequenceMatcher

BASE_FRAMES = ('base_link', 'base_footprint', 'base')
LASERS = ('laser', 'lidar', 'scan', 'hokuyo', 'rplidar', 'urg', 'sick', 'lds')
ALIKE = 0.75   # share of letters in which names are spellings of one


def plain(frame: str) -> str:
    """Return the frame name without the leading slash of old logs."""
    return frame.strip().lstrip('/')


def bare(frame: str, robot: str = '') -> str:
    """Return frame name without the prefix of a robot: robot1/laser, or robot1_laser of robot1."""
    last = plain(frame).rpartition('/')[2]
    return last.removeprefix(f'{robot}_') if robot else last


def prefix(frame: str) -> str:
    """Return the prefix of a frame name before its last slash; '' without one."""
    return plain(frame).rpartition('/')[0]


def is_moving(parent: str) -> bool:
    """Tell whether a frame is one in which a robot moves, so that what hangs on it is no mount."""
    last = bare(parent)
    return 'odom' in last.lower() or last in ('map', 'world', 'earth')


def is_odometry(parent: str) -> bool:
    """Tell whether a frame is one in which odometry places a robot: odom, robot1_odom, ..."""
    return 'odom' in bare(parent).lower()


def is_base(frame: str) -> bool:
    """Tell whether a frame is that of a robot itself: base_link, robot1_base_footprint, ..."""
    return bare(frame).endswith(BASE_FRAMES)


def spellings(frame: str, robot: str, known: Iterable[str]) -> list[str]:
    """
    Return the names in a tree that may mean a frame, the likeliest first.

    Parameters
    ----------
    frame : the name looked for, with or without the prefix of a robot
    robot : whose frame it is, '' where that is not known
    known : names in the tree

    """
    frame, known = plain(frame), set(known)
    robot = robot.strip('/')
    last = bare(frame, robot)
    wanted = [frame, last]
    if robot:
        wanted = [f'{robot}/{last}', f'{robot}_{last}', *wanted]
    found = [name for name in dict.fromkeys(wanted) if name in known]
    others = [name for name in known if bare(name) == last and name not in found]
    if not found and not prefix(frame) and not robot and len(others) == 1:
        found = others   # the one robot of this tree, which has a prefix here only
    return found


def similar(frame: str, robot: str, known: Iterable[str]) -> list[str]:
    """Return the names in a tree that are spelt like a laser's frame, but not of another robot."""
    own, last = {prefix(frame), robot.strip('/'), ''}, bare(frame, robot).lower()
    kind = {word for word in LASERS if word in last}
    return sorted(
        name for name in known if prefix(name) in own and not is_base(name)
        and (kind and any(word in bare(name).lower() for word in LASERS)
             or SequenceMatcher(None, last, bare(name, robot).lower()).ratio() > ALIKE))
