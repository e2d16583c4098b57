# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a fusion node draws for RViz: segments, surfaces, normals, matches."""

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
import numpy as np
from somfusion_ros.fusion.cluster_matching import match
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.geometry import Array, Pose
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

MATCH_ANGLE, MATCH_REACH = np.radians(10.0), 0.4   # [rad], [m] within which clusters match
NORMAL_LENGTH = 0.3                # [m] of a normal's arrow
GOLDEN_ANGLE = 2.399963            # [rad] between the hues of two segments
WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
RED = ColorRGBA(r=1.0, g=0.2, b=0.2, a=1.0)
YELLOW = ColorRGBA(r=1.0, g=0.9, b=0.2, a=1.0)


def matched_clusters(own: LearnedMap, peer: LearnedMap, T_own_peer: Pose) -> Array:
    """Return ends (N, 2, 2) [m] of lines from a peer's clusters to the own ones they match."""
    found = match(np.array(T_own_peer)[None], peer.features, own.features, own.nearest,
                  MATCH_ANGLE, MATCH_REACH)
    agrees = found.agrees[0]
    return np.stack([found.at[:, 0, agrees].T, own.features.centres[found.other[0, agrees]]], 1)


def team_markers(learned: LearnedMap, frame: str, stamp: Time,
                 matches: Array = np.empty((0, 2, 2))) -> MarkerArray:
    """Draw segments in colour, surfaces between clusters, point normals, and matches."""
    header, c = Header(frame_id=frame, stamp=stamp), learned.clusters
    segments = _marker(header, 'segments', Marker.POINTS, learned.cells, WHITE)
    segments.colors = [_hue(int(s)) for s in learned.segments]
    surfaces = _marker(header, 'surfaces', Marker.LINE_LIST, c.centres[c.edges].reshape(-1, 2),
                       WHITE)
    tips = c.centres + NORMAL_LENGTH * c.normals
    normals = _marker(header, 'normals', Marker.LINE_LIST,
                      np.stack([c.centres, tips], 1).reshape(-1, 2), YELLOW)
    matched = _marker(header, 'matches', Marker.LINE_LIST, matches.reshape(-1, 2), RED)
    return MarkerArray(markers=[segments, surfaces, normals, matched])


def _marker(header: Header, name: str, kind: int, points: Array, color: ColorRGBA) -> Marker:
    """Make one marker of points (N, 2)."""
    marker = Marker(header=header, ns=name, type=kind, action=Marker.ADD, color=color)
    marker.pose.orientation.w = 1.0
    marker.scale.x = marker.scale.y = 0.03
    marker.points = [Point(x=float(x), y=float(y)) for x, y in points]
    return marker


def _hue(segment: int) -> ColorRGBA:
    """Return the colour of a segment, unlike those of its neighbours in number."""
    phase = GOLDEN_ANGLE * segment + np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
    r, g, b = (float(v) for v in 0.55 + 0.45 * np.cos(phase))
    return ColorRGBA(r=r, g=g, b=b, a=1.0)
