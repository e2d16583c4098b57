# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The transforms of one robot in a bag: where its laser sits, and which is its odometry."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.frame_names import bare, is_base, is_odometry, plain, prefix
from somfusion_ros.io.frame_tree import FrameTree, Mount

TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')
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


def find_mount(reader: BagReader, base_frame: str, laser_frame: str, namespace: str = ''
               ) -> tuple[Mount | None, list[str]]:
    """
    Find the mount of a laser, and sentences on what was odd; BagError where it is tilted.

    Where there is no chain to the laser, but to one frame that is spelt alike, that one is used.
    """
    tree = FrameTree()
    mount = None
    for topic in transform_topics(reader, namespace):
        static = 'static' in topic
        for number, (_, _, message) in enumerate(reader.messages({topic})):
            if number >= SCANNED_FOR_STATIC and not static:
                break
            tree.add(message.transforms, static)
        mount = _mount(reader, tree, base_frame, laser_frame, namespace)
        if mount is not None:
            break
    notes = [f'{reader.path}: the transform {parent} -> {child} on tf_static was corrected later: '
             'the last one is used' for parent, child in dict.fromkeys(tree.corrected)]
    if mount is not None:
        return mount, notes
    alike = tree.similar(base_frame, laser_frame, namespace)
    if len(alike) > 1:
        raise reader.error(f'no transform from {base_frame} to the laser {laser_frame!r}, only to '
                           f'{", ".join(alike)}: give --laser-pose')
    if alike:
        mount = _mount(reader, tree, base_frame, alike[0], namespace)
        notes.append(f'{reader.path}: no transform from {base_frame} to {laser_frame!r}: that to '
                     f'{alike[0]!r} is used')
    return mount, notes


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
