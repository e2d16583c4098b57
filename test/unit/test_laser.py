# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What drivers of lasers get wrong in every scan alike, on simulated drives with truth."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import office
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.laser import emptiness
from somfusion_ros.slam.scan import Scan
from somfusion_ros.slam.session import Session

pytestmark = pytest.mark.slow

URG = Laser()
BEAMS, TRUE = URG.beams, URG.time_increment


@pytest.fixture(scope='module')
def trial() -> Trial:
    """Drive with turns of 1 rad/s while the mirror takes 0.067 s for its 240 degrees."""
    route = office().route(0)[:9]
    stamps, poses = drive.follow(route, 0.5, 0.5, 1000.0)
    return simulate_trial(lambda t: Scene(office().segments), stamps, poses, URG,
                          np.random.default_rng(0))


def error(trial: Trial, time_increment: float) -> tuple[float, Counter[str]]:
    """Largest error [m] of the trajectory where all scans tell a time_increment, and faults."""
    counts: Counter[str] = Counter()
    session = Session(SlamConfig(), 1e9, lambda kind, reason='': counts.update([kind]),
                      background=False, capacity=10000)
    for sample in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        session.add_odometry(*sample)
    for scan in trial.scans:
        session.add_scan(replace(scan, time_increment=time_increment), None, 0.0)
        list(session.steps(0.0))
    list(session.finish())
    stamps, poses = session.slam.trajectory()
    assert len(stamps) > len(trial.scans) - 5
    return float(np.hypot(*(poses - trial.truth(stamps))[:, :2].T).max()), counts


@pytest.mark.slow
@pytest.mark.parametrize(('told', 'odd'), [
    (TRUE, False), (TRUE * 1e6, True), (TRUE * 1e9, True), (TRUE * 1e3, True),
    (TRUE * (BEAMS - 1), True), (1.3 * URG.period / BEAMS, True), (np.nan, True), (np.inf, True),
    (1e30, True), (0.0, False)])
def test_a_time_increment_that_cannot_be_costs_nothing(trial: Trial, told: float,
                                                       odd: bool) -> None:
    """
    Micro-, nano- or milliseconds, the whole scan's time, a slower mirror, no number, none.

    With the true time_increment the largest error on this drive was 0.132 m.
    """
    found, counts = error(trial, told)
    assert found < 0.16
    assert bool(counts['scan_time_increment_impossible']) == odd


@pytest.mark.parametrize(('ranges', 'words'), [
    ([np.inf] * 9, '9 inf'), ([0.0] * 9, '9 0'), ([np.nan] * 9, '9 NaN'),
    ([2500.0] * 9, 'millimetres'), ([0.01] * 9, 'under range_min'),
    ([np.inf, 0.0, np.nan] * 3, '3 inf, 3 NaN, 3 0')])
def test_a_scan_without_a_usable_beam_says_why(ranges: list[float], words: str) -> None:
    scan = Scan(1.0, np.array(ranges), -1.0, 0.25, 0.1, 10.0)
    assert words in emptiness(scan)
    assert not emptiness(replace(scan, ranges=np.array([*ranges[:-1], 2.0])))


def test_millimetres_all_through_are_named() -> None:
    assert 'millimetres' in emptiness(Scan(1.0, np.full(9, 2500.0), -1.0, 0.25, 100.0, 12000.0))


@pytest.mark.parametrize(('beams', 'period'), [(90, 0.025), (90, 0.2), (3600, 0.2)])
@pytest.mark.parametrize('changing', [False, True])
def test_lasers_of_every_rate_and_number_of_beams(beams: int, period: float, changing: bool
                                                  ) -> None:
    """90 to 3600 beams, 5 to 40 Hz, also where every scan has a few beams more or less."""
    laser = Laser(beams=beams, field_of_view=2.0 * np.pi * (beams - 1) / beams, range_max=12.0,
                  period=period, turn=period)
    rng = np.random.default_rng(0)
    stamps, poses = drive.follow(office().route(2)[:3], 1.6, 0.5, 1000.0)
    counts: Counter[str] = Counter()
    session = Session(SlamConfig(), 1e9, lambda kind, reason='': counts.update([kind]),
                      background=False, capacity=10000)
    trial = simulate_trial(lambda t: Scene(office().segments), stamps, poses, laser, rng)
    for sample in zip(trial.odometry_stamps, trial.odometry, trial.slip, strict=True):
        session.add_odometry(*sample)
    for scan in trial.scans:
        count = beams - int(rng.integers(0, 6)) if changing else beams
        session.add_scan(replace(scan, ranges=scan.ranges[:count]), None, 0.0)
        list(session.steps(0.0))
    list(session.finish())
    times, found = session.slam.trajectory()
    assert len(times) >= len(trial.scans) - 3
    assert np.hypot(*(found - trial.truth(times))[:, :2].T).max() < 0.15
