# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A lidar whose mirror turns all the time, without odometry: it must not begin to swing."""

from dataclasses import replace

import numpy as np
import pytest
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import box, office
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session

CIRCLE = replace(Laser(), beams=455, field_of_view=2.0 * np.pi * 454 / 455, range_max=12.0)


def worst(trial: Trial) -> float:
    """Largest error [m] of the trajectory, of which no scan may be lost."""
    session, used = Session(SlamConfig(), 1.0, lambda kind, reason='': None, background=False,
                            odometry=False), 0
    for scan in trial.scans:
        session.add_scan(scan, None, 0.0)
        used += sum(step.matched for _, step in session.steps(0.0))
    used += sum(step.matched for _, step in session.finish())
    assert used >= len(trial.scans) - 1
    stamps, poses = session.slam.trajectory()
    return float(np.hypot(*(poses - trial.truth(stamps))[:, :2].T).max())


def test_one_that_stands_stands() -> None:
    room, stamps = box(0.0, 0.0, 4.0, 2.6), np.arange(0.0, 6.0, drive.STEP)
    poses = np.tile((-0.7, 0.2, 0.3), (len(stamps), 1))
    trial = simulate_trial(lambda t: Scene(room), stamps, poses, CIRCLE, np.random.default_rng(0))
    assert worst(trial) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize('laser', [CIRCLE, Laser()], ids=['circle', 'Hokuyo'])
def test_one_that_drives_is_followed(laser: Laser) -> None:
    stamps, poses = drive.follow(office().route(2)[:7], 1.6, 0.5, 1000.0)
    trial = simulate_trial(lambda t: Scene(office().segments), stamps, poses, laser,
                           np.random.default_rng(0))
    assert worst(trial) < 0.1
