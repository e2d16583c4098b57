# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Known places: which views may explain a scan, and which are out of date."""

from collections import Counter
from threading import Lock

from helpers import fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.slam import places
from somfusion_ros.slam.checkpoint import Checkpoint, ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.loop_closer import LoopCloser
from somfusion_ros.slam.scan import cloud
from somfusion_ros.slam.tracking import Tracker

CONFIG = SlamConfig()
Q = np.diag([0.01, 0.01, 0.005]) ** 2
HERE = np.array([2.0, 2.0, 0.3])


@settings(deadline=None)
@given(st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), max_size=40), st.integers(0, 40))
def test_a_place_has_few_views_and_they_are_the_nearest(given_poses: list, fresh: int) -> None:
    poses = np.array(given_poses).reshape(-1, 3)
    usable = np.arange(len(poses)) >= fresh
    place = places.known(np.zeros(3), poses, usable, CONFIG)
    apart = places.distance(np.zeros(3), poses, CONFIG)
    assert len(place.views) <= places.TUNING.tried
    assert all(usable[view] and apart[view] < places.TUNING.around for view in place.views)
    if place.views:
        others = np.delete(apart, place.views)[np.delete(usable, place.views)]
        assert (others >= apart[list(place.views)].max()).all()


def crowded(count: int) -> ViewGraph:
    """Return a graph of so many views at one place, the newest of which waits for its loops."""
    graph, seen = ViewGraph(), cloud(fake_scan(fake_room(), HERE, 0.0, beams=181), 30.0)
    for k in range(count):
        graph.ekf.augment(np.zeros(3), Q)
        if k:
            graph.constraints.append(Constraint(k - 1, k, np.zeros(3), Q))
        graph.clouds.append(seen)
        graph.centres.append(np.zeros(2))
        graph.stamps.append(float(k))
    graph.to_close.append(count - 1)
    return graph


def test_of_a_place_that_changes_again_and_again_the_newest_views_stay() -> None:
    graph = crowded(40)
    LoopCloser(graph, Lock(), CONFIG, counters := Counter()).work()
    old = 39 - CONFIG.loop_minimum_gap
    assert counters['views_outdated'] == old - places.TUNING.most
    assert np.array_equal(np.flatnonzero(graph.showing()),
                          np.arange(old - places.TUNING.most, 40))
    again = Checkpoint.of(graph, 39, Tracker(CONFIG).state()).graph()
    assert np.array_equal(again.showing(), graph.showing())
    assert all(len(cloud) > 0 for cloud in graph.clouds[old:])


def test_a_place_with_few_views_keeps_them() -> None:
    graph = crowded(CONFIG.loop_minimum_gap + places.TUNING.most)
    LoopCloser(graph, Lock(), CONFIG, counters := Counter()).work()
    assert not counters['views_outdated'] and graph.showing().all()
