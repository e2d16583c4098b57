# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The order in time of a laser's beams, learned from simulated drives whose truth is known."""

from collections import Counter
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from somfusion_ros.geometry import Array
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.simulate import drive_robot, SimulationOptions
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.beam_order import BeamOrder
from somfusion_ros.slam.beam_orders import MOST_EARLY
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.motion import OdometryBuffer
from somfusion_ros.slam.scan import cloud, Scan
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.sweep_order import in_order, Order, order_of, ORDERS

pytestmark = pytest.mark.slow

LASERS = {'5 Hz, all round': (5.0, 360, 359.0, 12.0), '10 Hz, 240 deg': (10.0, 513, 240.0, 4.5),
          '20 Hz, 270 deg': (20.0, 271, 270.0, 10.0)}
PATIENCE = 1e9


class Turned(Laser):
    """A laser whose driver turned the beams round and left time_increment positive."""

    def beam_times(self) -> Array:
        """Time (B,) [s] of every beam after the first in time."""
        return super().beam_times()[::-1]


class Still(Laser):
    """A laser whose driver undid the motion, or a simulated one, with a time_increment."""

    def beam_times(self) -> Array:
        """Time (B,) [s] of every beam: none passes."""
        return np.zeros(self.beams)


class Listed(Turned):
    """A clockwise laser whose driver lists the beams from another bearing than the first's."""

    def beam_times(self) -> Array:
        """Time (B,) [s] of every beam after the first in time."""
        return np.roll(super().beam_times(), round(0.25 * self.beams))


class Between(Turned):
    """The same, from a bearing between those that are tried."""

    def beam_times(self) -> Array:
        """Time (B,) [s] of every beam after the first in time."""
        return np.roll(super().beam_times(), round(0.62 * self.beams))


KINDS: dict[str, type[Laser]] = {'rising': Laser, 'falling': Turned, 'at_once': Still,
                                 'from a quarter on': Listed, 'from 0.62 on': Between}
TRUE = {**ORDERS, 'from a quarter on': Order(-1.0, 0.25), 'from 0.62 on': Order(-1.0, 0.625)}


@lru_cache
def trial(kind: str, laser: str, duration: float) -> Trial:
    """Drive through an office."""
    hz, beams, degrees, reach = LASERS[laser]
    plan, rng = PLANS['office'](), np.random.default_rng(1)
    run = drive_robot(plan, 1, SimulationOptions(duration=duration), rng)
    made = KINDS[kind](beams=beams, field_of_view=float(np.radians(degrees)), range_max=reach,
                       period=1.0 / hz, turn=1.0 / hz)
    return simulate_trial(lambda t: Scene(plan.segments), run.stamps, run.poses, made, rng)


def learned(drive: Trial, tell: float = 1.0) -> tuple[list[Scan], Counter[str]]:
    """Return the scans in the order that was found, and what was counted; tell: time's sign."""
    counts: Counter[str] = Counter()
    order, buffer = BeamOrder(lambda kind, why='': counts.update([kind])), OdometryBuffer()
    for stamp, pose in zip(drive.odometry_stamps, drive.odometry, strict=True):
        buffer.add(stamp, pose)
    mended = []
    for scan in drive.scans:
        odometry = buffer.at(scan.stamp, scan.sweep)
        if odometry is not None:
            told = replace(scan, time_increment=tell * scan.time_increment)
            mended.append(order.mend(told, odometry, SlamConfig()))
    return mended, counts


@pytest.mark.parametrize(('kind', 'laser'), [
    *((kind, laser) for kind in ORDERS for laser in list(LASERS)[:2]),
    ('falling', '20 Hz, 270 deg'),
    ('from a quarter on', '5 Hz, all round'), ('from 0.62 on', '5 Hz, all round')])
def test_the_order_is_found_within_45_s_of_driving(kind: str, laser: str) -> None:
    mended, counts = learned(trial(kind, laser, 45.0))
    assert order_of(mended[-1]) == TRUE[kind]
    assert (counts['scan_beam_order'] > 0) == (kind != 'rising')


def test_a_driver_that_tells_the_wrong_sign_is_not_believed() -> None:
    mended, counts = learned(trial('rising', '5 Hz, all round', 45.0), tell=-1.0)
    assert mended[-1].time_increment > 0.0
    assert counts['scan_beam_order'] > 0


def test_a_robot_that_never_turns_learns_nothing() -> None:
    drive = trial('falling', '5 Hz, all round', 45.0)
    straight = np.column_stack([0.3 * drive.odometry_stamps, *np.zeros((2, len(drive.odometry)))])
    mended, counts = learned(replace(drive, odometry=straight))
    assert not counts
    assert all(scan.time_increment > 0.0 for scan in mended)


def test_falling_order_undoes_what_rising_order_would_double() -> None:
    twist, turned = np.array([0.0, 0.0, 1.0]), trial('falling', '5 Hz, all round', 45.0).scans[0]
    rising, falling = (cloud(in_order(turned, ORDERS[order]), 30.0, twist)
                       for order in ('rising', 'falling'))
    once = cloud(in_order(turned, ORDERS['at_once']), 30.0)
    first, last = rising.outline.ends[[0, -1]], falling.outline.ends[[0, -1]]
    np.testing.assert_allclose(first[0], once.outline.ends[0], atol=1e-12)
    np.testing.assert_allclose(last[1], once.outline.ends[-1], atol=1e-12)


def run(drive: Trial, beam_order: str = 'auto') -> tuple[float, Counter[str], Session]:
    """Run the SLAM; return the largest error [m] of the trajectory, the counts, the session."""
    counts: Counter[str] = Counter()
    session = Session(SlamConfig(beam_order=beam_order), PATIENCE,
                      lambda kind, why='': counts.update([kind]), background=False)
    for sample in zip(drive.odometry_stamps, drive.odometry, drive.slip, strict=True):
        session.add_odometry(*sample)
    for scan in drive.scans:
        session.add_scan(scan, None, 0.0)
        for _ in session.steps(0.0):
            pass
    stamps, poses = session.slam.trajectory()
    return float(np.hypot(*(poses - drive.truth(stamps))[:, :2].T).max()), counts, session


@pytest.mark.parametrize('kind', ['falling', 'from a quarter on'])
def test_a_map_that_began_in_the_wrong_order_is_begun_anew(kind: str) -> None:
    """Bound: 0.1 m where the order that was told makes over 0.5 m."""
    drive = trial(kind, '5 Hz, all round', 45.0)
    wrong, counts, _ = run(drive, 'rising')
    assert wrong > 0.5
    assert not counts['scan_beam_order']
    right, counts, session = run(drive)
    assert right < 0.1
    assert counts['scan_beam_order'] > 0
    assert session.slam.counters['scans'] == len(drive.scans) - 1, 'each once; the last waits'
    assert session.slam.epoch.reset == 1, 'the team hears that it is another map'


def test_what_is_kept_until_the_order_is_known_is_bounded() -> None:
    drive = trial('falling', '20 Hz, 270 deg', 45.0)
    _, _, session = run(replace(drive, scans=drive.scans[:40]))
    orders = session._orders
    assert orders._early
    for k in range(2 * MOST_EARLY):
        early = orders._early[0] if orders._early else None
        if early is None:
            return
        orders._keep(early._replace(scan=replace(early.scan, stamp=10.0 + k)), SlamConfig())
    raise AssertionError('it keeps them for ever')


def test_an_order_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match='beam_order'):
        SlamConfig(beam_order='clockwise')
