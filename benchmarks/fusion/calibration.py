# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Who is accepted, at which probability, and how well calibrated that probability is.

usage: python -m benchmarks.fusion.calibration PAIRS_DIR [--replays DIR ...] [--share S]
       [--kinds NAME ...] [--keep FILE] [--fit]

Judges true pairs of maps and pairs of different places of every kind that cases.py makes of the
pairs, of maps that `somfusion replay` wrote, and of drawn maps. Prints, per kind, how many are
accepted; the whole curve of accepts of true and of false pairs against the threshold; and a
reliability table. With --fit it also learns the weights anew, judges each case by weights learned
without its places, and prints the weights for somfusion_ros/fusion/verdict.py.
"""

import argparse
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
import pickle
import sys

from benchmarks.data.real_maps import RealMaps
from benchmarks.fusion import cases
from benchmarks.tables import Table
import cv2
import numpy as np
from scipy.optimize import minimize
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.alignment import ALIGNMENT
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.search import search
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.fusion.verification import verify
from somfusion_ros.geometry import Array, inverse

TESTS = (verdicts.AGREEMENT, verdicts.DISTINCTION, verdicts.PLACES)
NAMES = [name for test in TESTS for name in test]
THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
SEVERE = 6.0     # a false accept counts as so many refusals
TEAM = 30.0      # and so many does a refused team of real robots, of which there are few


@dataclass
class Sample:
    """What the verdict saw of a case, whether its best pose was right, its probability."""

    kind: str
    number: int
    places: set[str]
    true: bool
    measures: Array
    right: bool
    probability: float
    reason: str


def look(kind: str, number: int, case: cases.Case) -> Sample | None:
    """Run the search and the verdict on a case; None where a map shows too little."""
    config = FusionConfig()
    maps = learn(case.target, config), learn(case.source, config)
    if min(len(one.features) for one in maps) < ALIGNMENT.fewest_features:
        return None
    swapped = len(maps[0].cells) < len(maps[1].cells)
    target, source = maps[::-1] if swapped else maps
    verdict, poses, _, evidence, _ = verify(*search(target, source, config, Stopwatch()), target,
                                            source, config)
    pose = inverse(poses[verdict.best]) if swapped else poses[verdict.best]
    found = verdicts.measures(evidence, verdict.margins)
    return Sample(kind, number, case.places, case.truth is not None,
                  np.array([found[name] for name in NAMES]), case.is_right(pose),
                  verdict.probability, verdict.reason)


def collect(maps: RealMaps, share: float, kinds: list[str] | None) -> list[Sample]:
    """Judge a share of the cases of every kind, or of some."""
    samples = []
    for kind, (_, count) in cases.KINDS.items():
        if kinds and kind not in kinds:
            continue
        wanted = np.linspace(0, count - 1, max(1, round(count * share)), dtype=int)
        for number in np.unique(wanted):
            case = cases.make(kind, maps, int(number))
            sample = look(kind, int(number), case) if case else None
            if sample:
                samples.append(sample)
        print(f'{kind}: {len(samples)} cases so far', file=sys.stderr, flush=True)
    return samples


def log_odds(weights: Array, x: Array) -> Array:
    """Soft minimum of the tests, (N,), for measures (N, M)."""
    ends = np.cumsum([0] + [len(test) for test in TESTS])
    tests = [x[:, a:b] @ weights[a:b] for a, b in pairwise(ends)]
    return -np.logaddexp.reduce(np.negative(tests))


def fit(samples: list[Sample], starts: int = 3) -> Array:
    """Weights (M,) of largest likelihood; only constants may be negative."""
    x, y = np.array([s.measures for s in samples]), np.array([s.right for s in samples])
    care = np.where(y, [TEAM if s.kind == 'team' else 1.0 for s in samples], SEVERE)
    constant = np.array([name == 'constant' for name in NAMES])
    ends = np.cumsum([0] + [len(test) for test in TESTS])

    def loss(weights: Array) -> tuple[float, Array]:
        tests = np.array([x[:, a:b] @ weights[a:b] for a, b in pairwise(ends)])
        z = -np.logaddexp.reduce(-tests)
        slope = care * (1.0 / (1.0 + np.exp(-np.clip(z, -30.0, 30.0))) - y) * np.exp(z - tests)
        gradient = np.concatenate([part @ x[:, a:b] for part, (a, b) in zip(
            slope, pairwise(ends), strict=True)])
        small = 0.03 * np.where(constant, 0.0, weights)
        return (float((care * np.logaddexp(0.0, np.where(y, -z, z))).sum() + small @ weights),
                gradient + 2.0 * small)
    rng, bounds = np.random.default_rng(0), [(None if c else 0.0, None) for c in constant]
    found = [minimize(loss, np.where(constant, rng.uniform(-3, 3, len(NAMES)),
                                     rng.uniform(0.3, 3, len(NAMES))), jac=True, bounds=bounds,
                      method='L-BFGS-B', options={'maxiter': 2000}) for _ in range(starts)]
    return min(found, key=lambda result: result.fun).x


def left_out(samples: list[Sample]) -> Array:
    """Probabilities (N,) of each sample by weights learned without its places."""
    chance = np.zeros(len(samples))
    for place in sorted(set.union(*(sample.places for sample in samples))):
        held = np.array([place in sample.places for sample in samples])
        weights = fit([s for s, out in zip(samples, held, strict=True) if not out], 2)
        z = log_odds(weights, np.array([s.measures for s in samples])[held])
        chance[held] = np.maximum(chance[held], 1.0 / (1.0 + np.exp(-z)))
    return chance


def probabilities(samples: list[Sample]) -> Array:
    """Return what the verdict said of each sample, (N,)."""
    return np.array([sample.probability for sample in samples])


def kinds_table(samples: list[Sample], chance: Array) -> Table:
    """Return how many of each kind are right and accepted; chance: their probabilities (N,)."""
    kinds = defaultdict(list)
    for sample, p in zip(samples, chance, strict=True):
        kinds[not sample.true, sample.kind].append((p, sample.right))
    enough = FusionConfig().estimation_confidence
    table = Table('kinds', ('kind of pair', 'cases', 'best pose right',
                            f'right and accepted at {enough:.2f}', 'accepted wrong',
                            'highest probability of a wrong one'), (None, 0, 3, 3, 0, 3))
    for (_, kind), values in sorted(kinds.items()):
        p, right = np.array([v[0] for v in values]), np.array([v[1] for v in values])
        table.add(kind, len(p), right.mean(), (right & (p >= enough)).mean(),
                  int((~right & (p >= enough)).sum()), max(p[~right], default=0.0))
    return table


def thresholds_table(samples: list[Sample], chance: Array) -> Table:
    """Return how many are accepted at which probability; chance: their probabilities (N,)."""
    y, true = np.array([s.right for s in samples]), np.array([s.true for s in samples])
    table = Table('thresholds', ('threshold', 'cases', *(f'{t:.2f}' for t in THRESHOLDS)))
    for name, mask, of in (('true pairs, right pose', true & y, true),
                           ('true pairs, wrong pose', true & ~y, true),
                           ('different places', ~true, ~true)):
        table.add(name, int(of.sum()), *(int((chance[mask] >= t).sum()) for t in THRESHOLDS))
    return table


def reliability_table(chance: Array, right: Array) -> Table:
    """Return how often a probability is right; the last row is the expected calibration error."""
    table, error = Table('reliability', ('probability', 'cases', 'mean', 'right'),
                         (None, 0, 2, 2)), 0.0
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (chance >= low) & (chance < low + 0.1 if low < 0.85 else chance <= 1.0)
        if inside.any():
            error += inside.mean() * abs(chance[inside].mean() - right[inside].mean())
            table.add(f'{low:.1f} to {low + 0.1:.1f}', int(inside.sum()), chance[inside].mean(),
                      right[inside].mean())
    table.add('expected error', len(chance), f'{error:.3f}', '')
    return table


def print_tables(samples: list[Sample], chance: Array) -> None:
    """Print accepted cases by kind, the curve over thresholds, and the reliability."""
    right = np.array([sample.right for sample in samples])
    print(kinds_table(samples, chance).markdown(), thresholds_table(samples, chance).markdown(),
          reliability_table(chance, right).markdown(), sep='\n\n', end='\n\n')


def main() -> None:
    """Collect, print, and fit if asked."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('pairs', type=Path)
    parser.add_argument('--replays', type=Path, nargs='*', default=[],
                        help='folders that somfusion replay wrote')
    parser.add_argument('--share', type=float, default=1.0, help='share of the cases')
    parser.add_argument('--kinds', nargs='*', help='only these')
    parser.add_argument('--keep', type=Path, help='file to keep the samples in, or to take them')
    parser.add_argument('--fit', action='store_true')
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.keep and args.keep.exists():
        samples = pickle.loads(args.keep.read_bytes())
    else:
        samples = collect(RealMaps(args.pairs, args.replays), args.share, args.kinds)
        if args.keep:
            args.keep.write_bytes(pickle.dumps(samples))
    print_tables(samples, probabilities(samples))
    for sample in samples:
        if sample.probability >= FusionConfig().estimation_confidence and not sample.right:
            print(f'wrongly accepted: {sample.kind} {sample.number} at {sample.probability:.3f}, '
                  f'{sample.reason}')
    if args.fit:
        print('learned anew, each place left out in turn:')
        print_tables(samples, left_out(samples))
        for name, weight in zip(NAMES, fit(samples), strict=True):
            print(f'{name:15} {weight:8.3f}')


if __name__ == '__main__':
    main()
