# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Relative orientation from histograms of normals, tuned by Radon images (section III-A, (5)-(8)).

Angles are source to target, counter-clockwise. The circular cross-correlation of the two 360
degree histograms peaks at the relative orientation; buildings are rectangular, so that its rivals
at 90, 180 and 270 degrees are kept as hypotheses too. The tuning compares how sharply the walls
of both maps project onto lines of every direction, which is finer than one degree.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from somfusion_ros.geometry import Array
from somfusion_ros.settings import tuned

BINS = 360


@dataclass(frozen=True)
class OrientationSettings:
    """Numbers that the orientation was tuned with."""

    per_degree: int = tuned(
        2, 'directions',
        'of the Radon images in a degree',
        'by design')
    tuning: float = tuned(
        4.0, 'deg',
        'furthest that the tuning may go from a peak of the histogram',
        'by design')


ORIENTATION = OrientationSettings()


def histogram(normals: Array, weights: Array, sided: Array, sigma: float = 2.0) -> Array:
    """
    Count normals by direction in 360 bins of one degree, weighted and smoothed on the circle.

    A normal whose sign is unsure counts for its opposite too. normals (N, 2); weights (N,); sided
    (N,) 0..1; sigma of the smoothing [deg].
    """
    degrees = np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    sure = (1.0 + sided) / 2.0
    counts = np.zeros(BINS)
    for shift, share in ((0.0, sure), (180.0, 1.0 - sure)):
        place = (degrees + shift) % BINS
        low = np.floor(place).astype(np.intp)
        part = place - low
        counts += np.bincount(low % BINS, weights * share * (1.0 - part), BINS)
        counts += np.bincount((low + 1) % BINS, weights * share * part, BINS)
    wave = np.fft.rfftfreq(BINS, 1.0 / BINS)
    smooth = np.exp(-0.5 * (2.0 * np.pi * wave * sigma / BINS) ** 2)
    return np.fft.irfft(np.fft.rfft(counts) * smooth, BINS)


def correlate(target: Array, source: Array) -> Array:
    """Return circular cross-correlation: [k] is the agreement when the source turns by k bins."""
    a, b = target - target.mean(), source - source.mean()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    product = np.fft.rfft(a) * np.conj(np.fft.rfft(b))
    agreement: Array = np.fft.irfft(product, len(a)) / max(scale, 1e-12)
    return agreement


def peaks(correlation: Array, count: int, apart: int = 12) -> Array:
    """Return the highest maxima of a circular array, `apart` bins or more apart [rad]."""
    rest, found = correlation.copy(), list[float]()
    top = correlation.max()
    while len(found) < count:
        k = int(rest.argmax())
        if found and rest[k] < 0.4 * top:
            break
        if correlation[k] >= max(correlation[k - 1], correlation[(k + 1) % len(rest)]):
            found.append(_vertex(correlation, k))
        rest[(k + np.arange(-apart, apart + 1)) % len(rest)] = -np.inf
        if not np.isfinite(rest.max()):
            break
    return np.radians(np.asarray(found) * 360.0 / len(correlation))


def radon(points: Array, weights: Array, directions: Array, cell: float) -> Array:
    """
    Return a Radon image: for each direction (D,) [rad] how much wall lies at each offset along it.

    The origin of the offsets is the points' weighted mean; shape (D, offsets of edge `cell` [m]).
    """
    centred = points - np.average(points, axis=0, weights=weights)
    reach = np.hypot(*centred.T).max() + cell
    size = int(np.ceil(2.0 * reach / cell)) + 1
    axes = np.column_stack([np.cos(directions), np.sin(directions)]) / cell
    place = axes @ centred.T
    place += reach / cell + np.arange(len(directions))[:, None] * size
    low = place.astype(np.intp)
    place -= low
    place *= weights
    image = np.zeros(len(directions) * size + 1)
    np.add.at(image, low.ravel(), (weights - place).ravel())
    np.add.at(image[1:], low.ravel(), place.ravel())
    return image[:-1].reshape(len(directions), size)


def spectrum(image: Array) -> Array:
    """Return sharpness per projection (D,): walls seen edge-on make high peaks (5), (6)."""
    return np.asarray(np.einsum('do,do->d', image, image))


def tune(coarse: Array, target: Array, source: Array) -> Array:
    """
    Move orientations (N,) [rad] to where the Radon spectra agree best nearby (7), (8).

    The spectra span half a turn at `ORIENTATION.per_degree` steps per degree.
    """
    agreement = correlate(target, source)
    count = len(agreement)
    fine = ORIENTATION.per_degree
    reach = np.arange(-round(ORIENTATION.tuning * fine), round(ORIENTATION.tuning * fine) + 1)
    found = []
    for angle in coarse:
        near = (round(np.degrees(angle) * fine) + reach) % count
        # A mild pull keeps the histogram's word where the walls have no sharp direction.
        score = agreement[near] - 0.02 * (reach / fine) ** 2 / ORIENTATION.tuning ** 2
        k = int(score.argmax())
        shift = _vertex(agreement, int(near[k])) - near[k] + reach[k]
        found.append(np.radians((round(np.degrees(angle) * fine) + shift) / fine))
    return np.asarray(found)


def directions() -> Array:
    """Return the directions [rad] of the Radon images: half a turn."""
    return np.radians(np.arange(180 * ORIENTATION.per_degree) / ORIENTATION.per_degree)


def families(angles: Array, apart: float = np.radians(3.0)) -> Array:
    """Return distinct angles (M,) modulo a quarter turn [rad], best first: four turns each."""
    quarter, kept = np.pi / 2.0, list[float]()
    for angle in angles % quarter:
        off = [abs((angle - other + quarter / 2.0) % quarter - quarter / 2.0) for other in kept]
        if not off or min(off) > apart:
            kept.append(float(angle))
    return np.asarray(kept)


def _vertex(values: NDArray[np.float64], k: int) -> float:
    """Place of the maximum of the parabola through bins k - 1, k, k + 1 of a circular array."""
    before, here, after = values[k - 1], values[k], values[(k + 1) % len(values)]
    bend = before - 2.0 * here + after
    return k + (0.5 * (before - after) / bend if bend < 0 else 0.0)
