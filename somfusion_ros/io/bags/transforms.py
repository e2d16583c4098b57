# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits on the robot, from the transforms of a bag."""

from somfusion_ros.io.bags.reader import BagReader
from somfusion_ros.io.frame_tree import FrameTree, Mount

TF_TYPES = ('tf2_msgs/msg/TFMessage', 'tf/msg/tfMessage')
SCANNED_FOR_STATIC = 2000         # messages of /tf looked through where tf_static has no chain


def find_mount(reader: BagReader, base_frame: str, laser_frame: str) -> Mount | None:
    """Give the mount, from tf_static where it has one; BagError where the laser is tilted."""
    tree, topics = FrameTree(), reader.topics(*TF_TYPES)
    for topic in sorted(topics, key=lambda t: 'static' not in t):
        for number, (_, _, message) in enumerate(reader.messages({topic})):
            if number >= SCANNED_FOR_STATIC and 'static' not in topic:
                break
            tree.add(message.transforms)
        mount = _mount(reader, tree, base_frame, laser_frame)
        if mount is not None:
            return mount
    return _mount(reader, tree, base_frame, laser_frame)


def _mount(reader: BagReader, tree: FrameTree, base_frame: str,
           laser_frame: str) -> Mount | None:
    """Look the mount up in what is known; BagError names the bag."""
    try:
        return tree.mount(base_frame, laser_frame)
    except ValueError as error:
        raise reader.error(str(error)) from None
