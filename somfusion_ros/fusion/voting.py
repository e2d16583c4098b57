# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Seeds for the local translation search: all pairs of clusters vote at once.

Algorithm 2 is local, so it gets seeds. Every cluster is drawn on a coarse grid as a complex
number, its normal on doubled angles. The correlation of two such grids adds up cos(2 * angle
between normals) over the pairs of clusters that a shift brings together: parallel walls vote for
it, crossing walls against it. Whitening, as in phase correlation, keeps long walls and dense
clutter from drowning what is rare; without it the right shift ranks tens of places lower where
the maps share little.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft
from somfusion_ros.fusion.clusters import Clusters
from somfusion_ros.geometry import Array, rotation
from somfusion_ros.settings import tuned

QUARTERS = 4


@dataclass(frozen=True)
class VotingSettings:
    """Numbers that the votes were tuned with."""

    smooth: float = tuned(
        1.0, 'bins',
        'width of a vote: two maps of one wall differ by as much',
        'benchmarks/fusion/stages.py')
    white: float = tuned(
        0.9, '',
        'share of the whitening: 0 plain correlation, 1 phase correlation, which noise '
        'spoils',
        'benchmarks/fusion/stages.py')
    of_a_turn: int = tuned(
        10, 'peaks', 'of the votes of one turn are compared with those of others', 'by design')


VOTING = VotingSettings()


class VoteGrid:
    """Two maps drawn on one coarse grid, the source turned by any of a family of angles."""

    def __init__(self, target: Clusters, source: Clusters, bin_size: float, max_bins: int) -> None:
        """Draw the target; `bin_size` [m] grows where more than `max_bins` would be needed."""
        self.centre_target, side, _ = _extent(target.centres)
        self.centre_source, _, reach = _extent(source.centres)
        self.source = source
        extent = side + 2.0 * reach     # of all places of the source that touch the target
        self.bin = max(bin_size, extent / max_bins)
        self.size = fft.next_fast_len(int(np.ceil(extent / self.bin)) + 2)
        self.target = self._draw(target, target.centres - self.centre_target, target.normals)
        wave = fft.fftfreq(self.size)
        blur = np.exp(-2.0 * (np.pi * VOTING.smooth * wave) ** 2).astype(np.float32)
        self.target *= (blur[:, None] * blur / self.size ** 2).astype(np.float32)

    def seeds(self, theta: float, count: int) -> Array:
        """
        Find the best shifts of the source turned by theta [rad] and by its 4-fold companions.

        A turn by 90 degrees only re-indexes the source's spectrum, so that the companions need
        no transform of their own.

        Returns
        -------
        (4, count, 3) poses T_target_source, best first for each of the four turns
        """
        found = []
        for angle, votes in self._votes(theta):
            shift = self._peaks(votes, count)
            found.append(self._poses(shift, angle))
        return np.stack(found)

    def outstanding(self, turns: Array, count: int) -> Array:
        """
        Find the shifts, at any of many turns (T,) [rad], whose votes stand out most.

        How far a peak stands out is its height in standard deviations of all votes of its turn.

        Returns
        -------
        (count, 3) poses T_target_source, best first
        """
        poses, heights = [], []
        for theta in turns:
            for angle, votes in self._votes(theta):
                shift = self._peaks(votes, VOTING.of_a_turn)
                poses.append(self._poses(shift, angle))
                heights.append(votes[shift[:, 1], shift[:, 0]] / cv2.meanStdDev(votes)[1])
        best = np.argsort(-np.concatenate(heights, axis=None), kind='stable')[:count]
        return np.concatenate(poses)[best]

    def _votes(self, theta: float) -> Iterator[tuple[float, NDArray[np.float32]]]:
        """Vote for all shifts of the source turned by theta [rad], and by quarter turns more."""
        R = rotation(theta)
        spectrum = self._draw(self.source, (self.source.centres - self.centre_source) @ R.T,
                              self.source.normals @ R.T)
        for quarter in range(QUARTERS):
            if quarter:
                spectrum = _quarter_turn(spectrum)
            sign = -1.0 if quarter % 2 else 1.0     # doubled angles: 90 degrees is half a turn
            votes = sign * _transform(self.target * np.conj(spectrum), cv2.DFT_INVERSE).real
            yield theta + quarter * np.pi / 2.0, votes

    def _poses(self, shift: NDArray[np.intp], angle: float) -> Array:
        """Return the poses (K, 3) of the source turned by an angle and shifted by (K, 2) bins."""
        at = shift * self.bin + self.centre_target - rotation(angle) @ self.centre_source
        return np.column_stack([at, np.full(len(at), angle)])

    def _peaks(self, votes: Array, count: int) -> NDArray[np.intp]:
        """Return the highest local maxima (count, 2) as signed shifts (x, y) [bins]."""
        peak = np.flatnonzero(votes >= cv2.dilate(votes, np.ones((3, 3), np.uint8)))
        height = votes.ravel()[peak]
        if len(peak) > count:
            strong = height >= np.partition(height, -count)[-count]
            peak, height = peak[strong], height[strong]
        best = np.resize(peak[np.argsort(-height, kind='stable')], count)
        shift = np.column_stack(np.divmod(best, self.size)[::-1])
        return np.where(shift > self.size // 2, shift - self.size, shift)

    def _draw(self, clusters: Clusters, places: Array, normals: Array) -> NDArray[np.complex64]:
        """Return the whitened transform of clusters at (K, 2) [m] around the grid's origin."""
        value = clusters.weights * clusters.straight * (normals[:, 0] + 1j * normals[:, 1]) ** 2
        low = np.floor(places / self.bin).astype(np.intp)
        part = places / self.bin - low
        flat, drawn = [], []
        for dx, px in ((0, 1.0 - part[:, 0]), (1, part[:, 0])):
            for dy, py in ((0, 1.0 - part[:, 1]), (1, part[:, 1])):
                row, column = (low[:, 1] + dy) % self.size, (low[:, 0] + dx) % self.size
                flat.append(row * self.size + column)
                drawn.append(value * px * py)
        image = np.zeros(self.size ** 2, np.complex64)
        np.add.at(image, np.concatenate(flat), np.concatenate(drawn).astype(np.complex64))
        spectrum = _transform(image.reshape(self.size, self.size))
        power = spectrum.real ** 2 + spectrum.imag ** 2
        gain = cv2.pow(power + np.float32(1e-4) * power.mean(), -VOTING.white / 2.0)
        return np.asarray(spectrum * gain, np.complex64)


def _transform(image: NDArray[np.complex64], flags: int = 0) -> NDArray[np.complex64]:
    """Return the discrete Fourier transform (N, N), or N * N times its inverse."""
    pairs = image.view(np.float32).reshape(*image.shape, 2)
    return cv2.dft(pairs, flags=flags).view(np.complex64)[:, :, 0]


def _quarter_turn(spectrum: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Return the spectrum of the image turned by 90 degrees about the grid's origin."""
    # f'(x, y) = f(y, -x), so F'(kx, ky) = F(ky, -kx): rows are y, columns x.
    flipped = np.roll(spectrum[::-1], 1, axis=0)    # ky -> -ky
    return np.ascontiguousarray(flipped.T)


def _extent(points: Array) -> tuple[Array, float, float]:
    """Return centre (2,) and longer side of the points' box, and their reach around it [m]."""
    centre, sides = (points.min(0) + points.max(0)) / 2.0, np.ptp(points, axis=0)
    return centre, float(sides.max()), float(np.hypot(*(points - centre).T).max())
