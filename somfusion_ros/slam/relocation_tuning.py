# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""When a lost robot believes that it has found itself."""

from dataclasses import dataclass

from somfusion_ros.settings import tuned


@dataclass(frozen=True)
class RelocationTuning:
    """When a lost robot believes that it has found itself."""

    views: int = tuned(
        12, 'views', 'newest, that are searched for together; more tell places that look alike '
        'apart, but are bent by drift', 'intel, wean')
    views_least: int = tuned(
        6, 'views', 'fewer are not searched for', 'intel, wean')
    thinned: float = tuned(
        0.05, 'm', 'edge of a square of the map that keeps one point', 'not measured')
    query: float = tuned(
        0.1, 'm', 'edge of a square of what is searched for, that keeps one point',
        'not measured')
    tile: float = tuned(
        4.0, 'm', 'half the edge of a window of the search; larger ones cost memory',
        'not measured')
    margin: float = tuned(
        2.0, 'm', 'from the views of the map, within which the robot is sought', 'by design')
    on_surface: float = tuned(
        0.15, 'm', 'a point this near lies on the surface', 'intel, wean')
    off_surface: float = tuned(
        0.3, 'm', 'a point this far lies off it', 'intel, wean')
    least: float = tuned(
        0.35, 'score', 'of the search below which no pose is looked at; lower costs time',
        'intel, wean')
    least_rival: float = tuned(
        0.25, 'score', 'of the search below which a pose is no rival', 'intel, wean')
    explained: float = tuned(
        0.5, 'share of points', 'that lie on the surface of the map, at least', 'intel, wean')
    agreement: float = tuned(
        0.8, 'share', 'of what both sides saw, that agrees, at least', 'intel, wean')
    clearer: float = tuned(
        1.8, 'times', 'as much as the best pose leaves open, every other pose must leave open; '
        'wrong poses came to 1.7', 'intel, wean')
    left: float = tuned(
        0.02, 'share', 'that any pose leaves open', 'by design')
    left_astray: float = tuned(
        0.04, 'share', 'the same where the robot went astray as it drove: it may be where nothing '
        'was seen yet, and rooms look alike; wrong poses came to 0.034',
        'benchmarks/slam/look_alikes.py')
    sure: tuple[float, float] = tuned(
        (0.1, 0.03), 'm, rad', 'sigma of the match in its weakest direction, at most',
        'by design')
    stands: tuple[float, float] = tuned(
        (0.8, 0.9), 'share', 'of a scan that is explained, and that agrees, where the robot has '
        'stood before', 'test/unit/test_relocation.py')
    prior: float = tuned(
        0.03, 'share', 'by which the place where it stood may fit worse than the best',
        'test/unit/test_relocation.py')
    same: tuple[float, float] = tuned(
        (0.3, 0.06), 'm, rad', 'between what two searches found, at most', 'intel, wean')


TUNING = RelocationTuning()
