# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transforms of one robot in a bag: where its laser sits, and which is its odometry."""

from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from somfusion_ros.io.bags.reader import BagError, BagReader
from somfusion_ros.io.frame_names import bare, is_base, is_odometry, plain, prefix
from somfusion_ros.io.frame_tree import FrameTree, Mount

TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')
MOST_CORRECTIONS, MOST_NOTES = 1000, 3   # of one mount
SCANNED_FOR_STATIC = 2000         # messages of /tf looked through where tf_static has no chain


def in_namespace(topic: str, namespace: str) -> bool:
    """Tell whether a topic is in a robot's namespace; all are in that of the only robot."""
    return not namespace or topic.strip('/').startswith(namespace + '/')


def transform_topics(reader: BagReader, namespace: str) -> list[str]:
    """Return topics with a robot's transforms, fixed ones first: its own, or those of all."""
    topics = sorted(reader.topics(*TF_TYPES), key=lambda topic: 'static' not in topic)
    own = [topic for topic in topics if in_namespace(topic, namespace)]
    shared = [topic for topic in topics if topic.strip('/') in ('tf', 'tf_static')]
    return own if own == topics else [*own, *(t for t in shared if t not in own)]


@dataclass(frozen=True)
class Mounts:
    """
    Where a laser sits: its mount from the beginning, and those that came later.

    later: time of recording [s] and mount, in the order of time.
    """

    first: Mount
    later: list[tuple[float, Mount]] = field(default_factory=list)

    def at(self, log_time: float) -> Mount:
        """Return the mount that holds for a scan recorded at a time [s]."""
        return next((mount for since, mount in reversed(self.later) if log_time >= since),
                    self.first)


def find_mounts(reader: BagReader, base_frame: str, laser_frame: str, namespace: str = '',
                others: Collection[str] = ()) -> tuple[Mounts | None, list[str]]:
    """
    Find the mount of a laser, and sentences on what was odd; BagError where it is tilted.

    Where there is no chain to the laser, but to one frame that is spelt alike, that one is used,
    unless it is among the others: frames of other lasers.
    """
    tree, mounts = _look_up(reader, base_frame, laser_frame, namespace)
    notes = [f'{reader.path}: the mount of {laser_frame!r} on tf_static was corrected at '
             f'{since:.3f} s: it is taken from then on'
             for since, _ in (mounts.later[:MOST_NOTES] if mounts else [])]
    if mounts is not None:
        return mounts, notes
    taken = {bare(frame, namespace) for frame in others}
    alike = [name for name in tree.similar(base_frame, laser_frame, namespace)
             if bare(name, namespace) not in taken]
    if len(alike) > 1:
        raise reader.error(f'no transform from {base_frame} to the laser {laser_frame!r}, only to '
                           f'{", ".join(alike)}: give --laser-pose')
    if alike:
        mounts = _mounts(_mount(reader, tree, base_frame, alike[0], namespace))
        notes.append(f'{reader.path}: no transform from {base_frame} to {laser_frame!r}: that to '
                     f'{alike[0]!r} is used')
    return mounts, notes


def difference(reader: BagReader, given: Mount, base_frame: str, laser_frame: str,
               namespace: str = '') -> str:
    """Say how a mount that is given differs from that in the bag; '' where it hardly does."""
    try:
        found = _look_up(reader, base_frame, laser_frame, namespace)[1]
    except BagError as error:
        return f'laser_pose is used, though {error}'
    return '' if found is None else given.difference(found.at(np.inf), laser_frame)


def _look_up(reader: BagReader, base_frame: str, laser_frame: str, namespace: str
             ) -> tuple[FrameTree, Mounts | None]:
    """Return the transforms of a bag, and the mounts of a laser, None where it has none."""
    tree = FrameTree()
    mounts: Mounts | None = None
    for topic in transform_topics(reader, namespace):
        static = 'static' in topic
        for number, (_, log_time, message) in enumerate(reader.messages({topic})):
            if number >= SCANNED_FOR_STATIC and not static:
                break
            known = len(tree.corrected)
            tree.add(message.transforms, static)
            if mounts is not None and len(tree.corrected) > known:
                _correct(mounts, log_time, _mount(reader, tree, base_frame, laser_frame,
                                                  namespace))
            elif mounts is None and static:
                mounts = _mounts(_mount(reader, tree, base_frame, laser_frame, namespace))
        mounts = mounts or _mounts(_mount(reader, tree, base_frame, laser_frame, namespace))
        if mounts is not None:
            break
    return tree, mounts


def _mounts(mount: Mount | None) -> Mounts | None:
    """Return the mounts of a laser that has one; None where it has none."""
    return None if mount is None else Mounts(mount)


def _correct(mounts: Mounts, log_time: float, mount: Mount | None) -> None:
    """Keep the mount of a laser that was corrected, if it is another one."""
    if mount is not None and mount != mounts.at(np.inf):
        mounts.later.append((log_time, mount))
        del mounts.later[:-MOST_CORRECTIONS]


def odometry_frames(reader: BagReader, namespace: str = '') -> tuple[str, tuple[str, str]] | None:
    """
    Find the transform that is a robot's odometry: its topic, and its two frames.

    None where there is none. It may come after thousands of other transforms.
    """
    for topic in transform_topics(reader, namespace):
        if 'static' in topic:
            continue
        pairs = Counter(pair for _, _, message in reader.messages({topic})
                        for pair in pairs_of(message))
        found = best_odometry(pairs, namespace)
        if found is not None:
            return topic, found
    return None


def pairs_of(message: Any) -> list[tuple[str, str]]:
    """Return parent and child of each transform of a message."""
    return [(plain(item.header.frame_id), plain(item.child_frame_id))
            for item in message.transforms]


def best_odometry(pairs: Iterable[tuple[str, str]], robot: str = '') -> tuple[str, str] | None:
    """Return the frames of the odometry among parents and children; None where there are none."""
    found = [(parent, child) for parent, child in pairs if is_odometry(parent)]
    if robot:
        marks = (f'{robot}/', f'{robot}_')
        own = [pair for pair in found if any(frame.startswith(marks) for frame in pair)]
        found = own or [pair for pair in found if not any(map(prefix, pair))]
    return max(found, key=lambda pair: (is_base(pair[1]), bare(pair[0], robot) == 'odom',
                                        pair), default=None)


def _mount(reader: BagReader, tree: FrameTree, base_frame: str, laser_frame: str,
           namespace: str) -> Mount | None:
    """Look the mount up in what is known; BagError names the bag."""
    try:
        return tree.mount(base_frame, laser_frame, namespace)
    except ValueError as error:
        raise reader.error(str(error)) from None
