# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
What the search and the verdict see of many cases, in several processes, kept as they come.

A study of twenty thousand cases takes half an hour and more. Its samples are written to a
file that is named after the code and the data they come from; where that file stands, they are
not judged again.
"""

from collections.abc import Iterable, Iterator
import hashlib
from multiprocessing import get_context
from pathlib import Path
import sys

from benchmarks.data.folders import pair_sets, ROOT
from benchmarks.data.real_maps import RealMaps
from benchmarks.fusion import cases
from benchmarks.fusion.verdict_fit import read_samples, Sample, write_samples
import cv2
from somfusion_ros.fusion import verdict as verdicts
from somfusion_ros.fusion.alignment import ALIGNMENT, find, may_be_image
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.fusion.learning import learn
from somfusion_ros.fusion.mirror import mirror
from somfusion_ros.fusion.stopwatch import Stopwatch
from somfusion_ros.geometry import inverse

IN_DOUBT = 0.05     # probability from which the mirror image is looked at
TOGETHER = 50     # cases that one process judges one after the other
KEPT_EVERY = 4     # such parts: writing all takes half a second
# What samples come from.
CODE = ('somfusion_ros/*.py', 'somfusion_ros/fusion/*.py', 'somfusion_ros/fusion/*.json',
        'benchmarks/data/*.py', 'benchmarks/fusion/*cases.py', 'benchmarks/scores/teams.py')
KEPT = ROOT / 'build' / 'calibration'
Number = tuple[str, int]     # kind, and number in it
_maps: list[RealMaps] = []     # of this process


def look(kind: str, number: int, case: cases.Case, cache: FusionCache) -> Sample | None:
    """Run the search and the verdict on a case; None where a map shows too little."""
    config = FusionConfig()
    maps = learn(case.target, config, cache), learn(case.source, config, cache)
    if min(len(one.features) for one in maps) < ALIGNMENT.fewest_features or not all(
            len(one.free) for one in maps):
        return None
    swapped = len(maps[0].cells) < len(maps[1].cells)
    target, source = maps[::-1] if swapped else maps
    found = find(target, source, config, Stopwatch())
    verdict, image = found.verdict, 0.0
    if verdict.probability > IN_DOUBT and may_be_image(found):
        other = find(target, mirror(source), config, Stopwatch())
        image = verdicts.image_times(found.evidence, other.verdict, other.evidence)
    pose = inverse(found.poses[verdict.best]) if swapped else found.poses[verdict.best]
    return Sample(kind, number, case.places, case.truth is not None, case.is_right(pose), image,
                  found.evidence, verdict.margins)


def digest(files: Iterable[Path]) -> str:
    """Return a digest of files."""
    total = hashlib.sha256()
    for path in files:
        total.update(path.read_bytes())
    return total.hexdigest()[:16]


def data_files(data: Path) -> list[Path]:
    """List the files of all pairs that are learned from."""
    return [path for folder in pair_sets(data) for path in sorted(folder.iterdir())]


def kept(data: Path, replays: list[Path]) -> Path:
    """Return the file of the cases that this code has judged with these data."""
    code = [path for pattern in CODE for path in sorted(ROOT.glob(pattern))]
    maps = [path for folder in replays for path in sorted(folder.glob('robot*/map.*'))]
    return KEPT / f'{digest([*code, *data_files(data), *maps])}.csv.gz'


def judge(data: Path, replays: list[Path], wanted: list[Number], jobs: int) -> list[Sample]:
    """Judge cases, but for those that are kept, and keep them; those that show too little lack."""
    path = kept(data, replays)
    path.parent.mkdir(parents=True, exist_ok=True)
    samples = read_samples(path) if path.exists() else []
    known = {(sample.kind, sample.number) for sample in samples}
    missing = [case for case in wanted if case not in known]
    for k, part in enumerate(_judged(data, replays, missing, jobs)):
        samples += part
        if (k + 1) % KEPT_EVERY == 0 or (k + 1) * TOGETHER >= len(missing):
            write_samples(path, samples)
            print(f'{min((k + 1) * TOGETHER, len(missing))} of {len(missing)} cases',
                  file=sys.stderr, flush=True)
    order = {case: k for k, case in enumerate(wanted)}
    return sorted((sample for sample in samples if (sample.kind, sample.number) in order),
                  key=lambda sample: order[sample.kind, sample.number])


def _judged(data: Path, replays: list[Path], wanted: list[Number],
            jobs: int) -> Iterator[list[Sample]]:
    """Judge cases in processes of their own, some together, in their order."""
    parts = [wanted[k:k + TOGETHER] for k in range(0, len(wanted), TOGETHER)]
    with get_context('spawn').Pool(jobs, _begin, (data / 'pairs', replays)) as pool:
        yield from pool.imap(_judge_some, parts)


def _begin(pairs: Path, replays: list[Path]) -> None:
    """Read what a process needs."""
    cv2.setNumThreads(1)
    _maps[:] = [RealMaps(pairs, replays)]


def _judge_some(wanted: list[Number]) -> list[Sample]:
    """Judge a few cases."""
    cache, found = FusionCache(), []
    for kind, number in wanted:
        case = cases.make(kind, _maps[0], number)
        sample = look(kind, number, case, cache) if case else None
        if sample:
            found.append(sample)
    return found
