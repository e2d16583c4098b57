# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The weights of the verdict, learned from the measures of many cases."""

from collections import Counter
import csv
from dataclasses import dataclass
from functools import cached_property
import gzip
import io
from pathlib import Path

from benchmarks.data.folders import ROOT
from benchmarks.fusion.cases import REAL
import numpy as np
from scipy.optimize import minimize
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.measures import Evidence
from somfusion_ros.geometry import Array
from somfusion_ros.whole_files import write_files

TERMS = [(test, name) for test, names in verdicts.TESTS.items() for name in names]
MEASURES = list(dict.fromkeys(name for _, name in TERMS if name != 'constant'))
SEVERE = 8.0     # a false accept counts as so many refusals,
ALIKE = ('floors', 'storeys', 'real_storeys')     # of a storey of one building as half a one
HEEDED = ('true', 'team', 'different', 'mesh', 'floors', 'years', 'closed_doors')     # threefold
LEAST = {'ratio': 1.0}     # of a weight: half of all wall against is too much, whatever the rest
SEEN = ('matched', 'against', 'fine', 'fine_against', 'overlap', 'weak', 'weak_against', 'V',
        'solid', 'solid_against', 'common', 'strain', 'scale', 'passable', 'passable_other')
MARGINS = ('margin', 'odds', 'weak_margin')
SMALL = 0.03     # pull of the weights to zero
TABLE = ROOT / 'benchmarks' / 'fusion' / 'verdict_cases.csv.gz'
Weights = dict[str, dict[str, float]]


@dataclass
class Sample:
    """
    What the verdict saw of a case.

    places: a case is left out with any of them; true: whether there is a right pose; right:
    whether the best pose is; image: how many times as well the mirror image fits, 0 where that
    was not asked; the evidence for the best pose, and its margins over its rivals.
    """

    kind: str
    number: int
    places: set[str]
    true: bool
    right: bool
    image: float
    evidence: Evidence
    margins: verdicts.Margins

    @cached_property
    def measures(self) -> Array:
        """Measures (M,) in the order of MEASURES."""
        found = verdicts.measures(self.evidence, self.margins)
        return np.array([found[name] for name in MEASURES])


def log_odds(weights: Weights, samples: list[Sample]) -> Array:
    """Log odds (N,) of samples, as the verdict finds them."""
    flat = np.array([weights[test][name] for test, name in TERMS])
    chance = verdicts.soft_minimum(_tests(flat, _columns(samples)))
    least = np.log(verdicts.VERDICT.image_chance / (1.0 - verdicts.VERDICT.image_chance))
    mirrored = np.array([sample.image >= verdicts.VERDICT.image for sample in samples])
    return np.where(mirrored, np.minimum(chance, least), chance)


def cares(samples: list[Sample]) -> Array:
    """
    Return how much each sample (N,) counts: all kinds alike, however many there are of each.

    Else the real years, storeys and teams, of which there are few, would not be heard. What is
    real, or stands for the years that no map at hand shows, counts three times.
    """
    counts = Counter((sample.kind, sample.true) for sample in samples)
    costs = np.array([1.0 if sample.right else 0.5 if sample.kind in ALIKE else SEVERE
                      for sample in samples])
    heed = np.array([3.0 if sample.kind in HEEDED and (sample.right or sample.kind in REAL)
                     else 1.0 for sample in samples])
    each = np.array([counts[sample.kind, sample.true] for sample in samples])
    return np.asarray(costs * heed * len(samples) / (len(counts) * each))


def fit(samples: list[Sample], starts: int = 3) -> Weights:
    """Find the weights of largest likelihood; only constants may be negative."""
    # What the mirror image decides needs no weights.
    samples = [sample for sample in samples if sample.image < verdicts.VERDICT.image]
    x, right = _columns(samples), np.array([sample.right for sample in samples])
    care = cares(samples)
    constant = np.array([name == 'constant' for _, name in TERMS])

    def loss(flat: Array) -> tuple[float, Array]:
        tests = _tests(flat, x)
        z = verdicts.soft_minimum(tests)
        slope = care * (verdicts.chance_of(z) - right) * np.exp(z - tests)
        gradient = np.array([slope[list(verdicts.TESTS).index(test)] @ column
                             for (test, _), column in zip(TERMS, x.T, strict=True)])
        small = SMALL * np.where(constant, 0.0, flat)
        return (float((care * np.logaddexp(0.0, np.where(right, -z, z))).sum() + small @ flat),
                gradient + 2.0 * small)
    rng = np.random.default_rng(0)
    bounds = [(None if name == 'constant' else LEAST.get(name, 0.0), None) for _, name in TERMS]
    found = [minimize(loss, np.where(constant, rng.uniform(-3, 3, len(TERMS)),
                                     rng.uniform(0.3, 3, len(TERMS))), jac=True, bounds=bounds,
                      method='L-BFGS-B', options={'maxiter': 2000}) for _ in range(starts)]
    best = min(found, key=lambda result: result.fun).x
    return {test: {name: round(float(weight), 4) for (t, name), weight in zip(
        TERMS, best, strict=True) if t == test} for test in verdicts.TESTS}


def left_out(samples: list[Sample]) -> Array:
    """Probabilities (N,) of each sample by weights learned without its places."""
    chance = np.zeros(len(samples))
    for place in sorted(set.union(*(sample.places for sample in samples))):
        held = np.array([place in sample.places for sample in samples])
        weights = fit([s for s, out in zip(samples, held, strict=True) if not out], 2)
        theirs = [s for s, out in zip(samples, held, strict=True) if out]
        chance[held] = np.maximum(chance[held], verdicts.chance_of(log_odds(weights, theirs)))
    return chance


def write_samples(path: Path, samples: list[Sample]) -> None:
    """Write samples as a compressed table."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator='\n')
    writer.writerow(['kind', 'number', 'places', 'true', 'right', 'image', *SEEN, *MARGINS])
    for s in samples:
        writer.writerow([s.kind, s.number, '+'.join(sorted(s.places)), int(s.true), int(s.right),
                         f'{s.image:.2f}',
                         *(f'{getattr(s.evidence, name):.4g}' for name in SEEN),
                         *(f'{getattr(s.margins, name):.4g}' for name in MARGINS)])
    write_files({path: gzip.compress(text.getvalue().encode(), mtime=0)})


def read_samples(path: Path) -> list[Sample]:
    """Read samples from a table."""
    rows = csv.DictReader(io.StringIO(gzip.decompress(path.read_bytes()).decode()))
    return [Sample(row['kind'], int(row['number']), set(row['places'].split('+')),
                   row['true'] == '1', row['right'] == '1', float(row['image']),
                   Evidence(axis=np.zeros(2), **{name: float(row[name]) for name in SEEN}),
                   verdicts.Margins(*(float(row[name]) for name in MARGINS))) for row in rows]


def _columns(samples: list[Sample]) -> Array:
    """Measures (N, T) of samples, one column for every term of every test."""
    values = np.array([sample.measures for sample in samples])
    one = np.ones(len(samples))
    return np.column_stack([one if name == 'constant' else values[:, MEASURES.index(name)]
                            for _, name in TERMS])


def _tests(flat: Array, x: Array) -> Array:
    """Log odds (tests, N) of every test from columns (N, T)."""
    return np.array([sum(flat[k] * x[:, k] for k, (t, _) in enumerate(TERMS) if t == test)
                     for test in verdicts.TESTS])
