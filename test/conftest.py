# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What every test gets: repeatable noise and, for tests of the nodes, a ROS graph of their own."""

import os

import numpy as np
import pytest

os.environ.setdefault('MPLBACKEND', 'Agg')
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')


@pytest.fixture
def rng() -> np.random.Generator:
    """Make noise that is the same in every run."""
    return np.random.default_rng(2011)


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """Choose a free ROS domain, set for this process and those it starts."""
    from somfusion_ros.ros.apps.processes import free_domain
    domain = free_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    return domain
