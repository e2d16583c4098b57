# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Bytes and clusters as standard messages and back.

Whatever is wrong with an incoming message raises ValueError with one line.
"""

from array import array

import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.io.cluster_rows import CLUSTER_FIELDS
from somfusion_ros.team.shared_map import TUNING
from std_msgs.msg import UInt8MultiArray

MAX_CLUSTERS = 4096


def bytes_message(data: bytes) -> UInt8MultiArray:
    """Wrap bytes; they go in as one block, one by one takes seconds."""
    block = array('B')
    block.frombytes(data)
    return UInt8MultiArray(data=block)


def bytes_from_message(message: UInt8MultiArray) -> bytes:
    """Unwrap bytes."""
    return bytes(message.data)


def clusters_from_message(cloud: PointCloud2) -> Clusters:
    """Return the clusters of a cloud; a normal that is there is taken as sure."""
    names = tuple(field.name for field in cloud.fields)
    step = 4 * len(CLUSTER_FIELDS)
    if names != CLUSTER_FIELDS or cloud.point_step != step or cloud.is_bigendian:
        raise ValueError(f'cloud of {names} is not one of clusters')
    if cloud.width > MAX_CLUSTERS or len(cloud.data) != step * cloud.width:
        raise ValueError(f'cloud of {cloud.width} clusters has {len(cloud.data)} bytes')
    rows = np.frombuffer(cloud.data, '<f4').reshape(-1, len(CLUSTER_FIELDS)).astype(float)
    if not (np.isfinite(rows).all() and np.abs(rows[:, :2]).max(initial=0.0) < TUNING.farthest):
        raise ValueError('cloud of clusters is not finite')
    length = np.hypot(rows[:, 3], rows[:, 4])
    sure = (length > 0.5).astype(float)
    normals = rows[:, 3:5] * (sure / np.maximum(length, 0.5))[:, None]
    return Clusters(centres=rows[:, :2], weights=np.clip(rows[:, 6], 0.0, 10.0),
                    segments=rows[:, 5].astype(np.intp), edges=np.empty((0, 2), np.intp),
                    normals=normals, straight=sure, sided=sure)
