# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure map fusion on pairs of real maps: what each stage brings, and other methods beside it.

usage: python -m benchmarks.fusion.stages PAIRS_DIR [--every N] [--rows NAME ...]

PAIRS_DIR holds manifest.csv and one npz per pair (target, source, resolution, origins). Prints a
table: `right` is the share of true pairs whose best pose is within 0.5 m and 5 deg (strict 0.1 m
and 1 deg), accepted or not; `success` is right and accepted; `false` counts accepted pairs of
different places, `wrong` accepted wrong poses of true pairs. One core. Asserts nothing.
"""

import argparse
from collections.abc import Callable, Sequence
import csv
from dataclasses import dataclass, field
from pathlib import Path
import time

from benchmarks.data.real_maps import load_pair
from benchmarks.fusion import baselines
from benchmarks.scores.pairs import PairScore, score_pair, summary
from benchmarks.tables import Table
import cv2
import numpy as np
from somfusion_ros.fusion import measures, orientation, rasters, scoring, translation, voting
from somfusion_ros.fusion.alignment import align, ALIGNMENT
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learned_map import LearnedMap
from somfusion_ros.fusion.learning import learn, LEARNING
from somfusion_ros.fusion.search import search
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.geometry import Pose, rotation
from somfusion_ros.grid import Grid

Found = tuple[np.ndarray | None, bool]


@dataclass
class Pair:
    """Two grids, the true pose (3,) or None, and the centre (2,) of the overlap."""

    target: Grid
    source: Grid
    truth: np.ndarray | None
    centre: np.ndarray | None
    cache: FusionCache = field(default_factory=FusionCache)

    @property
    def learned(self) -> tuple[LearnedMap, LearnedMap]:
        """Both maps as the clusters have them, learned once."""
        return learn(self.target, cache=self.cache), learn(self.source, cache=self.cache)


def load(folder: Path, row: dict[str, str]) -> Pair:
    """Read one pair; new Grid objects, so that nothing is learned already."""
    true = row['kind'] == 'pos'
    numbers = [np.array([float(row[name]) for name in names]) if true else None
               for names in (('x', 'y', 'theta'), ('centre_x', 'centre_y'))]
    return Pair(*load_pair(folder, row['name']), *numbers)


def turns_of(target: LearnedMap, source: LearnedMap, count: int) -> np.ndarray:
    """Tuned orientations from the histograms' best peaks."""
    correlation = orientation.correlate(target.histogram, source.histogram)
    return orientation.tune(orientation.peaks(correlation, count), target.spectrum,
                            source.spectrum)


def from_centroids(target: LearnedMap, source: LearnedMap, turns: np.ndarray) -> np.ndarray:
    """Start every turn with the maps' middles on one another."""
    return np.array([np.r_[target.pivot - rotation(t) @ source.pivot, t] for t in turns])


def best_by_V(target: LearnedMap, source: LearnedMap, starts: np.ndarray) -> Found:
    """Run the published translation from every start; V chooses, and accepts from 90 %."""
    nearest = rasters.nearest(target.features.centres, 2.0 * LEARNING.cell, 1.0)
    poses = np.array([translation.mean_shift(start, source.features, target.features,
                                             nearest)[0] for start in starts])
    V = np.array([item.V for item in measures.measure(poses, target, source)])
    return poses[V.argmax()], bool(V.max() >= ALIGNMENT.published_v)


def published(pair: Pair) -> Found:
    """One orientation, one start."""
    target, source = pair.learned
    return best_by_V(target, source, from_centroids(target, source, turns_of(target, source, 1)))


def four_fold(pair: Pair) -> Found:
    """All four companions of the best orientation."""
    target, source = pair.learned
    turns = turns_of(target, source, 1)[0] + np.arange(4) * np.pi / 2.0
    return best_by_V(target, source, from_centroids(target, source, turns))


def voted(pair: Pair) -> np.ndarray:
    """Seeds by votes of all cluster pairs, for every orientation."""
    target, source = pair.learned
    votes = voting.VoteGrid(target.features, source.features, 0.5, 512)
    return np.concatenate([votes.seeds(turn, 20).reshape(-1, 3) for turn in
                           orientation.families(turns_of(target, source, 4))])


def seeded(pair: Pair) -> Found:
    """Try the five best seeds of every turn; V chooses."""
    starts = voted(pair).reshape(-1, 20, 3)[:, :5].reshape(-1, 3)
    return best_by_V(*pair.learned, starts)


def rescored(pair: Pair) -> Found:
    """Settle all seeds point to line, and let matched wall against missed wall choose."""
    target, source = pair.learned
    poses, _ = translation.settle(voted(pair), source.sketch, target.features, target.nearest)
    score = scoring.scores(poses, target, source)
    best = poses[score.argmax()]
    evidence, = measures.measure(best[None], target, source)
    return best, bool(evidence.V >= ALIGNMENT.published_v)


def by_cells(pair: Pair) -> Found:
    """Let the cells choose among what the clusters propose."""
    target, source = pair.learned
    poses = search(target, source, FusionConfig(), Stopwatch()).poses
    evidence = measures.measure(poses, target, source)
    best = max(range(len(poses)), key=lambda k: evidence[k].score)
    return poses[best], bool(evidence[best].V >= ALIGNMENT.published_v)


def whole(pair: Pair) -> Found:
    """Refine and judge: the package as it is."""
    found = align(pair.target, pair.source)
    return _array(found.T_target_source), found.accepted


def coarse_clusters(pair: Pair) -> Found:
    """Use half as many clusters."""
    found = align(pair.target, pair.source, FusionConfig(cluster_spacing=0.8))
    return _array(found.T_target_source), found.accepted


def fine_clusters(pair: Pair) -> Found:
    """Use clusters of two cells: nearly the raw cells."""
    found = align(pair.target, pair.source, FusionConfig(cluster_spacing=0.1))
    return _array(found.T_target_source), found.accepted


ROWS: dict[str, Callable[[Pair], Found]] = {
    'the paper, literally': published, '+ four-fold hypotheses': four_fold,
    '+ seeds by votes': seeded, '+ rescoring': rescored, '+ cells choose': by_cells,
    '+ refinement and verdict': whole,
    'all, clusters 0.8 m': coarse_clusters, 'all, clusters 0.1 m': fine_clusters,
    'ORB, affine RANSAC': lambda pair: baselines.keypoints(
        pair.target, pair.source, cv2.ORB_create(2000)),
    'SIFT, affine RANSAC': lambda pair: baselines.keypoints(
        pair.target, pair.source, cv2.SIFT_create()),
    'Fourier-Mellin': lambda pair: baselines.fourier_mellin(pair.target, pair.source),
    'Hough spectrum': lambda pair: baselines.hough_spectrum(pair.target, pair.source),
}
for detector in ('AKAZE', 'KAZE', 'BRISK'):     # not in every build of OpenCV 5
    if hasattr(cv2, f'{detector}_create'):
        ROWS[f'{detector}, affine RANSAC'] = lambda pair, make=getattr(
            cv2, f'{detector}_create'): baselines.keypoints(pair.target, pair.source, make())


def _array(pose: Pose | None) -> np.ndarray | None:
    """Pose as an array, if there is one."""
    return None if pose is None else np.asarray(pose)


def measure(method: Callable[[Pair], Found], pairs: list[Pair]) -> list[PairScore]:
    """Score a method on pairs, of which nothing is learned yet; CPU time."""
    scores = []
    for pair in pairs:
        pair = Pair(*(Grid(g.evidence, g.resolution, g.T_frame_grid)
                      for g in (pair.target, pair.source)), pair.truth, pair.centre)
        start = time.process_time()
        pose, accepted = method(pair)
        seconds = time.process_time() - start
        scores.append(score_pair(pair.truth, pair.centre, pose, accepted, seconds))
    return scores


def stages_table(pairs: list[Pair], parts: Sequence[str] = ()) -> Table:
    """Return what each stage brings, and other methods; or only those whose name has a part."""
    table = Table('stages', ('method', 'right', 'strict', 'success', 'wrong', 'false',
                             'ms median', 'p95'), (None, 3, 3, 3, 0, 0, 0, 0))
    for name, method in ROWS.items():
        if not parts or any(part in name for part in parts):
            found = summary(measure(method, pairs))
            table.add(name, *(found[key] for key in (
                'right', 'strict', 'success', 'wrong', 'false', 'ms', 'p95')))
    return table


def pairs_table(folders: Sequence[Path], every: int = 1) -> Table:
    """Return how `align` does on sets of pairs."""
    table = Table('pairs', ('pairs', 'true', 'different places', 'success', 'strict',
                            'wrong accepts', 'false accepts', 'median error [m]', '[deg]',
                            'ms median', 'p95'), (None, 0, 0, 3, 3, 0, 0, 3, 3, 0, 0))
    for folder in folders:
        found = summary(measure(whole, load_all(folder, every)))
        table.add(folder.name, *(found[key] for key in (
            'true', 'different', 'success', 'strict', 'wrong', 'false', 'error', 'turn', 'ms',
            'p95')))
    return table


def load_all(folder: Path, every: int = 1) -> list[Pair]:
    """Read every n-th pair of a folder."""
    with open(folder / 'manifest.csv', encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    return [load(folder, row) for row in rows[::every]]


def sizes(pairs: list[Pair]) -> str:
    """Bytes of a map as clusters, as wall cells and as a whole grid; median."""
    rows = []
    for pair in pairs:
        one = learn(pair.target)
        rows.append((one.clusters.table.nbytes, 8 * len(one.cells), pair.target.evidence.size))
    found = np.median(rows, axis=0) / 1024.0
    return ('one map in kB, median: clusters {:.0f}, wall cells {:.0f}, '
            'grid {:.0f}'.format(*found))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('pairs', type=Path)
    parser.add_argument('--every', type=int, default=1, help='use every n-th pair')
    parser.add_argument('--rows', nargs='*', help='only methods whose name holds one of these')
    args = parser.parse_args()
    cv2.setNumThreads(1)
    pairs = load_all(args.pairs, args.every)
    absent = [name for name in ('AKAZE', 'KAZE', 'BRISK') if not hasattr(cv2, f'{name}_create')]
    if absent:
        print(f'OpenCV {cv2.__version__} lacks {", ".join(absent)}')
    print(sizes(pairs))
    print(stages_table(pairs, args.rows or ()).markdown())


if __name__ == '__main__':
    main()
