# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Seeds for the local translation search: all pairs of clusters vote at once.

Algorithm 2 is local, so it gets seeds. Every cluster is drawn on a coarse grid as a complex
number, its norm on doubled angles. The correlation of two such grids adds up cos(2 * angle
between norms) over the pairs of clusters that a shift brings together: parallel walls vote for
it, crossing walls against it. Whitening, as in phase correlation, keeps long walls and dense
clutter from drowning what is rare; without it the right shift ranks tens of places lower where
the maps share little.
"""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from somfusion_ros.fusion.features import Clusters
from somfusion_ros.geometry import Array, rotation

SMOOTH = 1.0      # width of a vote [bins]
WHITE = 0.9       # share of the whitening: 0 plain correlation, 1 phase correlation
QUARTERS = 4


class VoteGrid:
    """Two maps drawn on one coarse grid, the source turned by any of a family of angles."""

    def __init__(self, target: Clusters, source: Clusters, bin_size: float, max_bins: int) -> None:
        """Draw the target; `bin_size` [m] grows where more than `max_bins` would be needed."""
        self.centre_target, reach_t = _circle(target.centres)
        self.centre_source, reach_s = _circle(source.centres)
        self.source = source
        extent = 2.0 * (reach_t + reach_s)
        self.bin = max(bin_size, extent / max_bins)
        self.size = fft.next_fast_len(int(np.ceil(extent / self.bin)) + 2)
        self.target = self._draw(target, target.centres - self.centre_target, target.norms)
        wave = fft.fftfreq(self.size)
        blur = np.exp(-2.0 * (np.pi * SMOOTH * wave) ** 2).astype(np.float32)
        self.target *= blur[:, None] * blur

    def seeds(self, theta: float, count: int) -> Array:
        """
        Find the best shifts of the source turned by theta [rad] and by its 4-fold companions.

        A turn by 90 degrees only re-indexes the source's spectrum, so that the companions need
        no transform of their own.

        Returns
        -------
        (4, count, 3) poses T_target_source, best first for each of the four turns
        """
        R = rotation(theta)
        spectrum = self._draw(self.source, (self.source.centres - self.centre_source) @ R.T,
                              self.source.norms @ R.T)
        found = []
        for quarter in range(QUARTERS):
            sign = -1.0 if quarter % 2 else 1.0     # doubled angles: 90 degrees is half a turn
            votes = fft.ifft2(self.target * np.conj(spectrum)).real * sign
            angle = theta + quarter * np.pi / 2.0
            shift = self._peaks(votes, count) * self.bin
            at = shift + self.centre_target - rotation(angle) @ self.centre_source
            found.append(np.column_stack([at, np.full(len(at), angle)]))
            spectrum = _quarter_turn(spectrum)
        return np.stack(found)

    def _peaks(self, votes: Array, count: int) -> NDArray[np.intp]:
        """Highest local maxima (count, 2) as signed shifts (x, y) [bins]."""
        votes = votes.astype(np.float32)
        peak = np.flatnonzero(votes >= cv2.dilate(votes, np.ones((3, 3), np.uint8)))
        height = votes.ravel()[peak]
        if len(peak) > count:
            strong = height >= np.partition(height, -count)[-count]
            peak, height = peak[strong], height[strong]
        best = np.resize(peak[np.argsort(-height, kind='stable')], count)
        shift = np.column_stack(np.divmod(best, self.size)[::-1])
        return np.where(shift > self.size // 2, shift - self.size, shift)

    def _draw(self, clusters: Clusters, places: Array, norms: Array) -> NDArray[np.complex64]:
        """Whitened transform of clusters drawn at places (K, 2) [m] around the grid's origin."""
        value = clusters.weights * clusters.straight * (norms[:, 0] + 1j * norms[:, 1]) ** 2
        low = np.floor(places / self.bin).astype(np.intp)
        part = places / self.bin - low
        flat, drawn = [], []
        for dx, px in ((0, 1.0 - part[:, 0]), (1, part[:, 0])):
            for dy, py in ((0, 1.0 - part[:, 1]), (1, part[:, 1])):
                row, column = (low[:, 1] + dy) % self.size, (low[:, 0] + dx) % self.size
                flat.append(row * self.size + column)
                drawn.append(value * px * py)
        index, pull, area = np.concatenate(flat), np.concatenate(drawn), self.size ** 2
        image = np.empty(area, np.complex64)
        image.real = np.bincount(index, pull.real, area)
        image.imag = np.bincount(index, pull.imag, area)
        spectrum = fft.fft2(image.reshape(self.size, self.size))
        power = spectrum.real ** 2 + spectrum.imag ** 2
        return spectrum * (power + 1e-4 * power.mean()) ** np.float32(-WHITE / 2.0)


def _quarter_turn(spectrum: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Spectrum of the image turned by 90 degrees counter-clockwise about the grid's origin."""
    # f'(x, y) = f(y, -x), so F'(kx, ky) = F(ky, -kx): rows are y, columns x.
    flipped = np.roll(spectrum[::-1], 1, axis=0)    # ky -> -ky
    return np.ascontiguousarray(flipped.T)


def _circle(points: Array) -> tuple[Array, float]:
    """Centre (2,) of the bounding box and the reach [m] of the points around it."""
    centre = (points.min(0) + points.max(0)) / 2.0
    return centre, float(np.hypot(*(points - centre).T).max())
