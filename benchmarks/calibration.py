# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Learn the verdict's weights, and show how well calibrated its probability is.

usage: calibration.py PAIRS_DIR [--scale S] [--seed N] [--fit]

Makes true and false hypotheses from the pairs: as they are, bent, mirrored, cut without overlap,
crossed with other places; and from simulated corridors and offices. Prints, per kind, how many
are accepted, and a reliability table. With --fit it also learns the weights anew, each place left
out in turn for the second table, and prints them for somfusion_ros/fusion/verdict.py.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
import csv
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import numpy as np  # noqa: E402
from scipy.optimize import minimize  # noqa: E402
from somfusion_ros.config import FusionConfig  # noqa: E402
from somfusion_ros.fusion import verdict as verdicts  # noqa: E402
from somfusion_ros.fusion.alignment import Clock, search, verify  # noqa: E402
from somfusion_ros.fusion.learning import learn  # noqa: E402
from somfusion_ros.geometry import apply, Array, inverse, wrap  # noqa: E402
from somfusion_ros.grid import Grid  # noqa: E402
import worlds  # noqa: E402

TESTS = (verdicts.AGREEMENT, verdicts.DISTINCTION, verdicts.PLACES)
NAMES = [name for test in TESTS for name in test]


@dataclass
class Case:
    """Two maps; the truth (3,) or None, the spot (2,) where it counts, tolerances [m, rad]."""

    kind: str
    places: set[str]
    target: Grid
    source: Grid
    truth: Array | None = None
    spot: Array | None = None
    tolerance: tuple[float, float] = (0.5, np.radians(5.0))


@dataclass
class Sample:
    """What the verdict saw of a case, whether its best pose was right, its probability."""

    kind: str
    places: set[str]
    measures: Array
    right: bool
    probability: float


def load(folder: Path, row: dict[str, str]) -> tuple[Grid, Grid]:
    """Read one pair."""
    pair = np.load(folder / f'{row["name"]}.npz')
    return tuple(Grid.from_occupancy(pair[side], float(pair['resolution']),
                                     (*pair[f'{side}_origin'], 0.0))
                 for side in ('target', 'source'))


def real(folder: Path, rows: list[dict[str, str]], rng: worlds.Random) -> Iterator[Case]:
    """Make cases of every pair; a different place is as good as its mirror image."""
    for row in rows:
        target, source = load(folder, row)
        places = {row['place_target'], row['place_source']}
        other = rows[rng.integers(len(rows))]
        if not places & {other['place_target'], other['place_source']}:
            parts = worlds.halves(load(folder, other)[rng.integers(2)], rng.uniform(-5, 5), rng)
            yield Case('crossed', places | {other['place_target']}, target,
                       parts[rng.integers(2)])
        yield Case('gap', {row['place_target']}, *worlds.halves(target, -1.0, rng))
        if row['kind'] != 'pos':
            yield Case('different', places, target, source)
            continue
        truth, spot = (np.array([float(row[name]) for name in names])
                       for names in (('x', 'y', 'theta'), ('centre_x', 'centre_y')))
        yield Case('true', places, target, source, truth, spot)
        yield Case('mirrored', places, target, worlds.mirrored(source))
        degrees = rng.choice([2.0, 4.0, 6.0, 8.0])
        bent, move = worlds.bend(source, degrees, rng)
        ends = move(np.array([spot, spot + (0.5, 0.0)]))
        turn = truth[2] - np.arctan2(*(ends[1] - ends[0])[::-1])
        start = apply(truth, spot[None])[0] - apply((0, 0, turn), ends[:1])[0]
        yield Case(f'bent {degrees:.0f}', places, target, worlds.worn(bent, rng, 1.0),
                   np.array([*start, turn]), ends[0], (1.2, np.radians(degrees + 2.0)))


def simulated(count: int, rng: worlds.Random) -> Iterator[Case]:
    """Make corridors of equal width, offices of equal rooms: all different places."""
    for k in range(count):
        width = rng.uniform(1.5, 3.0)
        pair = [worlds.corridor(rng, width, rng.uniform(10, 80), k % 3) for _ in range(2)]
        yield Case('corridors', {f'corridor {k % 4}'}, *pair)
    for k in range(count // 2):
        pair = [worlds.office(rng, np.random.default_rng(k), int(rng.integers(4, 10)))
                for _ in range(2)]
        yield Case('offices', {f'office {k % 4}'}, *pair)


def look(case: Case) -> Sample | None:
    """Run the search and the verdict on a case."""
    config = FusionConfig()
    maps = learn(case.target, config), learn(case.source, config)
    if min(len(one.features) for one in maps) < 8:
        return None
    swapped = len(maps[0].cells) < len(maps[1].cells)
    target, source = maps[::-1] if swapped else maps
    poses, _ = search(target, source, config, Clock())
    verdict, poses, evidence, _ = verify(poses, target, source, config)
    pose = inverse(poses[verdict.best]) if swapped else poses[verdict.best]
    right = False
    if case.truth is not None:
        off = np.subtract(*(apply(T, case.spot[None])[0] for T in (pose, case.truth)))
        right = (np.hypot(*off) < case.tolerance[0]
                 and abs(wrap(pose[2] - case.truth[2])) < case.tolerance[1])
    found = verdicts.measures(evidence, verdict.margins)
    return Sample(case.kind, case.places, np.array([found[name] for name in NAMES]), bool(right),
                  verdict.probability)


def log_odds(weights: Array, x: Array) -> Array:
    """Soft minimum of the tests, (N,), for measures (N, M)."""
    ends = np.cumsum([0] + [len(test) for test in TESTS])
    tests = [(x[:, a:b] * weights[a:b]).sum(1) for a, b in zip(ends, ends[1:], strict=False)]
    return -np.logaddexp.reduce(np.negative(tests))


def fit(samples: list[Sample], starts: int = 4) -> Array:
    """Weights (M,) of largest likelihood; only constants may be negative; false counts twice."""
    x = np.array([sample.measures for sample in samples])
    y = np.array([sample.right for sample in samples])
    constant = np.array([name == 'constant' for name in NAMES])

    def loss(weights: Array) -> float:
        z = log_odds(weights, x)
        return float((np.where(y, 1.0, 2.0) * np.logaddexp(0.0, np.where(y, -z, z))).sum()
                     + 0.03 * (weights[~constant] ** 2).sum())
    rng, bounds = np.random.default_rng(0), [(None if c else 0.0, None) for c in constant]
    found = [minimize(loss, np.where(constant, rng.uniform(-3, 3, len(NAMES)),
                                     rng.uniform(0.3, 3, len(NAMES))), bounds=bounds,
                      method='L-BFGS-B', options={'maxiter': 2000, 'maxfun': 10 ** 6})
             for _ in range(starts)]
    return min(found, key=lambda result: result.fun).x


def left_out(samples: list[Sample]) -> Array:
    """Probabilities (N,) of each sample by weights learned without its places."""
    chance = np.full(len(samples), np.nan)
    for place in sorted(set.union(*(sample.places for sample in samples))):
        held = [place in sample.places for sample in samples]
        weights = fit([s for s, out in zip(samples, held, strict=True) if not out], 2)
        x = np.array([s.measures for s, out in zip(samples, held, strict=True) if out])
        chance[held] = 1.0 / (1.0 + np.exp(-log_odds(weights, x)))
    return chance


def table(samples: list[Sample], chance: Array) -> None:
    """Print accepted cases by kind, and the reliability of the probability."""
    kinds = defaultdict(list)
    for sample, p in zip(samples, chance, strict=True):
        kinds[sample.kind, sample.right].append(p)
    enough = FusionConfig().estimation_confidence
    print('kind          best pose  cases  accepted  highest p')
    for (kind, right), values in sorted(kinds.items()):
        print(f'{kind:13} {"right" if right else "wrong":9} {len(values):6d} '
              f'{np.mean(np.array(values) >= enough):9.3f} {max(values):10.3f}')
    y, error = np.array([sample.right for sample in samples]), 0.0
    print('probability   cases  mean p   right')
    for low in np.arange(0.0, 1.0, 0.1):
        inside = (chance >= low) & (chance < low + 0.1 if low < 0.85 else chance <= 1.0)
        if inside.any():
            gap = chance[inside].mean() - y[inside].mean()
            error += inside.mean() * abs(gap)
            print(f'{low:.1f} - {low + 0.1:.1f} {inside.sum():9d} {chance[inside].mean():7.2f} '
                  f'{y[inside].mean():7.2f}')
    print(f'expected calibration error {error:.3f}\n')


def main() -> None:
    """Collect, print, and fit if asked."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('pairs', type=Path)
    parser.add_argument('--scale', type=float, default=1.0, help='share of the cases')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--fit', action='store_true')
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    with open(args.pairs / 'manifest.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    rows = rows[::max(1, round(1.0 / args.scale))]
    cases = chain(real(args.pairs, rows, rng), simulated(round(150 * args.scale), rng))
    samples = [sample for case in cases if (sample := look(case)) is not None]
    table(samples, np.array([sample.probability for sample in samples]))
    if args.fit:
        print('learned anew, each place left out in turn:')
        table(samples, left_out(samples))
        for name, weight in zip(NAMES, fit(samples), strict=True):
            print(f'{name:15} {weight:8.3f}')


if __name__ == '__main__':
    main()
