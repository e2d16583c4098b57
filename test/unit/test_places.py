# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Known places: which views may explain a scan."""

from helpers import fake_room, fake_scan
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from somfusion_ros.slam import places
from somfusion_ros.slam.checkpoint import Checkpoint, ViewGraph
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import cloud
from somfusion_ros.slam.tracking import Tracker

CONFIG = SlamConfig()
Q = np.diag([0.01, 0.01, 0.005]) ** 2
HERE = np.array([2.0, 2.0, 0.3])


@settings(deadline=None)
@given(st.lists(st.tuples(*[st.floats(-3.0, 3.0)] * 3), max_size=40), st.integers(0, 40),
       st.booleans())
def test_a_place_has_few_views_and_they_are_the_nearest(given_poses: list, fresh: int,
                                                        often: bool) -> None:
    poses = np.array(given_poses).reshape(-1, 3)
    usable = np.arange(len(poses)) >= fresh
    place = places.known(np.zeros(3), poses, usable, often, CONFIG)
    apart = places.distance(np.zeros(3), poses, CONFIG)
    if often and (usable & (apart < places.TUNING.around)).any():
        assert place.views, 'one view nearby is enough where the robot has been often'
    assert len(place.views) <= places.TUNING.tried
    assert all(usable[view] and apart[view] < places.TUNING.around for view in place.views)
    if place.views:
        others = np.delete(apart, place.views)[np.delete(usable, place.views)]
        assert (others >= apart[list(place.views)].max()).all()


def test_a_hidden_view_keeps_its_place_and_makes_no_place_known() -> None:
    graph, seen = ViewGraph(), cloud(fake_scan(fake_room(), HERE, 0.0, beams=181), 30.0)
    for k in range(8):
        graph.ekf.augment(np.zeros(3), Q)
        if k:
            graph.constraints.append(Constraint(k - 1, k, np.zeros(3), Q))
        graph.clouds.append(seen)
        graph.centres.append(np.zeros(2))
        graph.stamps.append(float(k))
    graph.hide(range(1, 8))
    again = Checkpoint.of(graph, 0, Tracker(CONFIG).state()).graph()
    for one in (graph, again):
        assert np.array_equal(np.flatnonzero(one.showing()), [0]) and one.ekf.n == 8
        assert not places.known(np.zeros(3), one.ekf.poses, one.showing(), False, CONFIG).views


def test_a_place_that_two_passes_show_is_known() -> None:
    """One pass leaves its views; the third asks those of the first two."""
    step = CONFIG.minimum_travel_distance
    one = np.array([(k * step, 0.0, 0.0) for k in range(-2, 3)]) + (0.0, 1.4 * step, 0.0)
    far = np.array([(50.0 + k * step, 0.0, 0.0) for k in range(CONFIG.loop_minimum_gap + 1)])
    two = np.concatenate([one, far, one * (1.0, -1.0, 1.0)])
    for poses, known in ((one, False), (two, True)):
        usable = np.ones(len(poses), bool)
        assert bool(places.known(np.zeros(3), poses, usable, False, CONFIG).views) == known
