# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What fusion nodes say to one another, as messages and back.

Standard message types only. A node's state is one JSON document: all that it accepts now, so that
what is missing in it no longer holds, whatever was lost on the way. Whatever is wrong with an
incoming message raises ValueError with one line.
"""

from array import array
from collections.abc import Iterable
import json
from typing import Any, NamedTuple

import numpy as np
from sensor_msgs.msg import PointCloud2
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.geometry import Array, Pose
from somfusion_ros.io.cluster_rows import CLUSTER_FIELDS
from somfusion_ros.team.departed import Kept
from somfusion_ros.team.graph import Edge
from somfusion_ros.team.shared_map import FARTHEST
from std_msgs.msg import String, UInt8MultiArray

MAX_STATE = 1 << 18      # bytes of a state; an edge takes a quarter of a kilobyte
MAX_EDGES = 256          # that one robot can have accepted
MAX_NAME = 128           # letters of a robot's name
MAX_CLUSTERS = 4096
KINDS = ('match', 'sighting')
UPPER = np.triu_indices(3)
LEAST_VARIANCE, MOST_VARIANCE = 1e-12, 1e12


class State(NamedTuple):
    """
    What a fusion node accepts now, and what it keeps of robots that are gone.

    `session` changes whenever the node is started.
    """

    session: str
    edges: tuple[Edge, ...]
    kept: tuple[Kept, ...] = ()


def state_message(state: State) -> String:
    """Write a state; numbers keep every digit, so that all robots compute with the same."""
    return String(data=json.dumps({
        'session': state.session, 'edges': [_record(edge) for edge in state.edges],
        'kept': [{'robot': kept.robot, 'known': kept.known,
                  'edges': [_record(edge) for edge in kept.edges]} for kept in state.kept]}))


def state_from_message(message: String) -> State:
    """Read a state."""
    if len(message.data) > MAX_STATE:
        raise ValueError(f'state of {len(message.data)} bytes is over {MAX_STATE}')
    try:
        record = json.loads(message.data)
        return State(_word(record['session']), _edges(record['edges']), tuple(
            Kept(_word(item['robot']), int(item['known']), _edges(item['edges']))
            for item in record['kept']))
    except (KeyError, TypeError, AttributeError, RecursionError, OverflowError) as error:
        raise ValueError(f'state is not what a fusion node says: {error!r}') from error


def bytes_message(data: bytes) -> UInt8MultiArray:
    """Wrap bytes; they go in as one block, one by one takes seconds."""
    block = array('B')
    block.frombytes(data)
    return UInt8MultiArray(data=block)


def bytes_from_message(message: UInt8MultiArray) -> bytes:
    """Unwrap bytes."""
    return bytes(message.data)


def clusters_from_message(cloud: PointCloud2) -> Clusters:
    """Clusters of a cloud; a normal that is there is taken as sure."""
    names = tuple(field.name for field in cloud.fields)
    step = 4 * len(CLUSTER_FIELDS)
    if names != CLUSTER_FIELDS or cloud.point_step != step or cloud.is_bigendian:
        raise ValueError(f'cloud of {names} is not one of clusters')
    if cloud.width > MAX_CLUSTERS or len(cloud.data) != step * cloud.width:
        raise ValueError(f'cloud of {cloud.width} clusters has {len(cloud.data)} bytes')
    rows = np.frombuffer(cloud.data, '<f4').reshape(-1, len(CLUSTER_FIELDS)).astype(float)
    if not (np.isfinite(rows).all() and np.abs(rows[:, :2]).max(initial=0.0) < FARTHEST):
        raise ValueError('cloud of clusters is not finite')
    length = np.hypot(rows[:, 3], rows[:, 4])
    sure = (length > 0.5).astype(float)
    normals = rows[:, 3:5] * (sure / np.maximum(length, 0.5))[:, None]
    return Clusters(centres=rows[:, :2], weights=np.clip(rows[:, 6], 0.0, 10.0),
                    segments=rows[:, 5].astype(np.intp), edges=np.empty((0, 2), np.intp),
                    normals=normals, straight=sure, sided=sure)


def _record(edge: Edge) -> dict[str, Any]:
    """Write one edge."""
    return {'target': edge.target, 'source': edge.source, 'kind': edge.kind,
            'pose': list(edge.T_target_source), 'probability': float(edge.probability),
            'covariance': edge.covariance[UPPER].tolist()}


def _edges(items: list[dict[str, Any]]) -> tuple[Edge, ...]:
    """Read edges."""
    if len(items) > MAX_EDGES:
        raise ValueError(f'state of {len(items)} edges is over {MAX_EDGES}')
    return tuple(_edge(item) for item in items)


def _edge(item: dict[str, Any]) -> Edge:
    """Read one edge."""
    pose = Pose.from_array(item['pose'])
    if max(abs(pose.x), abs(pose.y)) > FARTHEST:
        raise ValueError(f'{pose.x:.3g}, {pose.y:.3g} is too far for the frame of a map')
    if item['kind'] not in KINDS or not 0.0 <= float(item['probability']) <= 1.0:
        raise ValueError(f'edge of kind {item["kind"]!r}, probability {item["probability"]!r}')
    target, source = _word(item['target']), _word(item['source'])
    if target == source:
        raise ValueError(f'edge from {target} to itself')
    return Edge(target, source, pose, _covariance(item['covariance']),
                float(item['probability']), item['kind'])


def _covariance(upper: Iterable[float]) -> Array:
    """Covariance (3, 3) of its upper triangle."""
    values = np.array(upper, dtype=float)
    if values.shape != (6,) or not np.isfinite(values).all():
        raise ValueError('covariance is not six finite numbers')
    P = np.zeros((3, 3))
    P[UPPER] = values
    P += np.triu(P, 1).T
    variances = np.linalg.eigvalsh(P)
    if not LEAST_VARIANCE < variances[0] <= variances[-1] < MOST_VARIANCE:
        raise ValueError(f'covariance has variances {variances.tolist()}')
    return P


def _word(value: Any) -> str:
    """Check a name."""
    if not isinstance(value, str) or not 0 < len(value) <= MAX_NAME:
        raise ValueError('a name is no word of at most 128 letters')
    return value
