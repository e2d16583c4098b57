# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the verdict reaches: by kind, by threshold, and how well its probability is calibrated."""

from collections.abc import Mapping
from pathlib import Path

from benchmarks.fusion.verdict_fit import Sample
from benchmarks.tables import Table
import matplotlib.figure as drawing
import numpy as np
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Array
from somfusion_ros.report.pictures import write_figure

THRESHOLDS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)
BINS = 10
# Kinds whose true and false pairs look alike: only together can a probability be right or wrong.
FAMILIES = {
    'laser': ('true', 'different', 'team', 'furnished', 'worn', 'redrawn', 'drawn_otherwise',
              'bent', 'parts', 'closed_doors', 'gap', 'wings', 'crossed', 'mirrored'),
    'mesh': ('mesh', 'mesh_like', 'mesh_false'),
    'years and storeys': ('floors', 'years', 'storeys', 'real_storeys'),
    'corridors': ('corridor', 'corridors', 'corridor_in_map'),
    'offices': ('office', 'offices'),
    'buildings': ('building', 'buildings'),
}


def kinds_table(samples: list[Sample], known: Array, out: Array) -> Table:
    """
    Return how many of each kind are accepted.

    known, out: probabilities (N,) by weights of all cases, and of the cases of other places.
    """
    enough = FusionConfig().estimation_confidence
    right = np.array([s.right for s in samples])
    table = Table('kinds', (
        'kind', 'cases', 'best pose right', f'right and accepted at {enough:.2f}',
        'wrong and accepted', 'right and accepted, place left out',
        'wrong and accepted, place left out'), (None, 0, 3, 3, 0, 3, 0))
    for kind, true in dict.fromkeys((s.kind, s.true) for s in samples):
        here = np.array([s.kind == kind and s.true == true for s in samples])
        mixed = not true and any(s.true for s in samples if s.kind == kind)
        rates: list[float] = []
        for chance in (known, out):
            accepted = chance[here] >= enough
            rates += [float((right[here] & accepted).mean()),
                      int((~right[here] & accepted).sum())]
        table.add(f'{kind}, different places' if mixed else kind, int(here.sum()),
                  float(right[here].mean()), *rates)
    return table


def thresholds_table(samples: list[Sample], chances: Mapping[str, Array]) -> Table:
    """Return how many are accepted at which probability, by probabilities (N,) of a name."""
    right, true = np.array([s.right for s in samples]), np.array([s.true for s in samples])
    table = Table('thresholds', ('threshold', 'cases', *(f'{t:.2f}' for t in THRESHOLDS)))
    for how, chance in chances.items():
        for name, mask, of in (('true pairs, right pose', true & right, true),
                               ('true pairs, wrong pose', true & ~right, true),
                               ('different places', ~true, ~true)):
            table.add(f'{how}: {name}', int(of.sum()),
                      *(int((chance[mask] >= t).sum()) for t in THRESHOLDS))
    return table


def calibration_error(chance: Array, right: Array) -> float:
    """Return the expected difference of a probability and how often it is right."""
    which = np.minimum((chance * BINS).astype(int), BINS - 1)
    return float(sum(abs(chance[which == k].mean() - right[which == k].mean())
                     * (which == k).mean() for k in np.unique(which)))


def calibration_errors(samples: list[Sample], chance: Array) -> dict[str, float]:
    """Calibration error over all cases and within each family of kinds."""
    right = np.array([s.right for s in samples])
    kinds = np.array([s.kind for s in samples])
    found = {'all': calibration_error(chance, right)}
    for family, members in FAMILIES.items():
        here = np.isin(kinds, members)
        if here.any():
            found[family] = calibration_error(chance[here], right[here])
    return {name: round(error, 3) for name, error in found.items()}


def calibration_table(samples: list[Sample], chances: Mapping[str, Array]) -> Table:
    """Return the calibration error of each family of kinds, by probabilities (N,) of a name."""
    errors = {name: calibration_errors(samples, chance) for name, chance in chances.items()}
    table = Table('calibration', ('kinds', *(f'calibration error, {name}' for name in errors)),
                  (None, *(3 for _ in errors)))
    for family in next(iter(errors.values())):
        table.add(family, *(found[family] for found in errors.values()))
    return table


def draw_reliability(path: Path, tables: Mapping[str, Array], right: Array) -> None:
    """Draw how often a probability is right."""
    figure = drawing.Figure(figsize=(5, 6), layout='constrained')
    axes, below = figure.subplots(2, sharex=True, height_ratios=(3, 1))
    axes.plot([0, 1], [0, 1], color='0.7')
    for name, chance in tables.items():
        which = np.minimum((chance * BINS).astype(int), BINS - 1)
        filled = [k for k in range(BINS) if (which == k).any()]
        axes.plot([chance[which == k].mean() for k in filled],
                  [right[which == k].mean() for k in filled], 'o-', label=name)
        below.hist(chance, bins=np.linspace(0.0, 1.0, BINS + 1), histtype='step')
    axes.set(ylabel='share that is right')
    axes.legend()
    below.set(xlabel='probability of the verdict', ylabel='cases', yscale='log')
    write_figure(path, figure, dpi=110)
