# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The weights of the verdict are those that its committed table of cases gives."""

import json

from benchmarks.fusion.verdict_fit import fit, log_odds, read_samples, Sample, TABLE
from benchmarks.fusion.verdict_tables import calibration_error
from helpers import ROOT
import numpy as np
import pytest
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.config import FusionConfig

pytestmark = pytest.mark.newest
ENOUGH = FusionConfig().estimation_confidence


@pytest.fixture(scope='module')
def samples() -> list[Sample]:
    """Read all cases."""
    return read_samples(TABLE)


def chances(weights: dict[str, dict[str, float]], samples: list[Sample]) -> np.ndarray:
    """Return the probability of every case."""
    return verdicts.chance_of(log_odds(weights, samples))


def test_a_refit_decides_as_the_package_does(samples: list[Sample]) -> None:
    """Learned anew, at most one case in two hundred changes sides at the default confidence."""
    again, used = chances(fit(samples), samples), chances(verdicts.weights(), samples)
    assert ((again >= ENOUGH) != (used >= ENOUGH)).mean() < 0.005
    assert np.abs(again - used).mean() < 0.01


def test_no_measure_speaks_against_what_it_measures() -> None:
    for test in verdicts.weights().values():
        assert all(weight >= 0.0 for name, weight in test.items() if name != 'constant')


def test_the_probability_is_calibrated(samples: list[Sample]) -> None:
    """How often a probability is right differs from it by less than 0.03 on average."""
    used = chances(verdicts.weights(), samples)
    assert calibration_error(used, np.array([s.right for s in samples])) < 0.03


def test_the_record_tells_where_the_weights_come_from(samples: list[Sample]) -> None:
    path = ROOT / 'somfusion_ros' / 'fusion' / verdicts.WEIGHTS_FILE
    record = json.loads(path.read_text(encoding='utf-8'))
    assert record['command'].startswith('make calibrate')
    assert record['commit'] and record['data']
    assert record['true cases'] == sum(s.true for s in samples)
    assert record['false cases'] == sum(not s.true for s in samples)
