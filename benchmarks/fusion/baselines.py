# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Other ways to align two grids, in the few lines that OpenCV and NumPy make possible."""

import cv2
import numpy as np
from somfusion_ros.geometry import compose, inverse
from somfusion_ros.grid import Grid

Found = tuple[np.ndarray | None, bool]


def picture(grid: Grid) -> np.ndarray:
    """Grey image (H, W) of a map: walls dark, free bright, unknown between."""
    return np.rint((grid.evidence + 1.0) * 127.0).astype(np.uint8)


def in_frames(affine: np.ndarray, target: Grid, source: Grid) -> np.ndarray:
    """Pose (3,) between map frames of an affine (2, 3) that takes source cells to target's."""
    theta = np.arctan2(affine[1, 0], affine[0, 0])
    shift = (affine[:, 2] + 0.5 - 0.5 * (affine[:, 0] + affine[:, 1])) * target.resolution
    cells = np.array([*shift, theta])
    return compose(compose(target.T_frame_grid, cells), inverse(source.T_frame_grid))


def keypoints(target: Grid, source: Grid, detector: cv2.Feature2D,
              confidence: float = 1.0) -> Found:
    """Match key points, estimate a similarity by RANSAC, accept as m-explore's map_merge does."""
    features = [detector.detectAndCompute(picture(grid), None) for grid in (source, target)]
    if any(found is None or len(found) < 3 for _, found in features):
        return None, False
    (points, one), (others, two) = features
    pairs = cv2.BFMatcher(detector.defaultNorm()).knnMatch(one, two, k=2)
    good = [p[0] for p in pairs if len(p) == 2 and p[0].distance < 0.7 * p[1].distance]
    if len(good) < 3:
        return None, False
    affine, inlier = cv2.estimateAffinePartial2D(
        np.float32([points[m.queryIdx].pt for m in good]),
        np.float32([others[m.trainIdx].pt for m in good]), ransacReprojThreshold=3.0)
    if affine is None:
        return None, False
    sure = inlier.sum() / (8.0 + 0.3 * len(good))
    return in_frames(affine, target, source), bool(sure >= confidence)


def fourier_mellin(target: Grid, source: Grid, size: int = 1024, cell: float = 0.2,
                   accept: float = 0.1) -> Found:
    """Turn from the walls' polar power spectra, shift by phase correlation, four-fold."""
    images, corners = zip(*(_walls(grid, size, cell) for grid in (target, source)), strict=True)
    spectra = [_polar(image) for image in images]
    product = np.fft.rfft(spectra[0]) * np.conj(np.fft.rfft(spectra[1]))
    step = np.pi / len(spectra[0])
    turn = np.fft.irfft(product, len(spectra[0])).argmax() * step
    best, strength = None, -1.0
    for theta in turn + np.arange(4) * np.pi / 2.0:
        R = cv2.getRotationMatrix2D((size / 2, size / 2), -np.degrees(theta), 1.0)
        (dx, dy), peak = cv2.phaseCorrelate(cv2.warpAffine(images[1], R, (size, size)), images[0])
        if peak > strength:
            R[:, 2] += (dx, dy)
            best, strength = R, peak
    grids = [Grid(np.zeros((1, 1), np.float32), cell, (*corner, 0.0)) for corner in corners]
    return in_frames(best, *grids), bool(strength >= accept)


def hough_spectrum(target: Grid, source: Grid, size: int = 1024, cell: float = 0.2,
                   accept: float = 0.6) -> Found:
    """
    Turn and shift from Hough spectra (Carpin 2008): best of the turns' peaks, by walls matched.

    The spectrum is the sum of squares of every column of the Hough image; shifts come from the
    correlation of the spectra of x and y.
    """
    images, corners = zip(*(_walls(grid, size, cell) for grid in (target, source)), strict=True)
    spectra = [_hough(image) for image in images]
    product = np.fft.rfft(spectra[0]) * np.conj(np.fft.rfft(spectra[1]))
    agreement = np.fft.irfft(product, len(spectra[0]))
    order = np.argsort(-agreement)
    turns = [order[0]]
    for k in order:
        if min(abs((k - t + 90) % 180 - 90) for t in turns) > 10 and len(turns) < 4:
            turns.append(k)
    best, strength = None, -1.0
    for turn in [t + half for t in turns for half in (0, 180)]:
        R = cv2.getRotationMatrix2D((size / 2, size / 2), -float(turn), 1.0)
        moved = cv2.warpAffine(images[1], R, (size, size))
        shift = [_shift(images[0].sum(axis), moved.sum(axis)) for axis in (0, 1)]
        R[:, 2] += shift
        placed = cv2.warpAffine(images[1], R, (size, size))
        matched = float((placed * images[0]).sum() / max((placed * placed).sum(), 1e-6))
        if matched > strength:
            best, strength = R, matched
    grids = [Grid(np.zeros((1, 1), np.float32), cell, (*corner, 0.0)) for corner in corners]
    return in_frames(best, *grids), bool(strength >= accept)


def _hough(image: np.ndarray) -> np.ndarray:
    """Hough spectrum (180,): how sharply the walls project onto each direction."""
    rows, columns = np.nonzero(image > 0.2)
    x, y = columns - image.shape[1] / 2.0, rows - image.shape[0] / 2.0
    spectrum = np.empty(180)
    for degree in range(180):
        angle = np.radians(degree)
        offset = np.rint(x * np.cos(angle) + y * np.sin(angle)).astype(int) + image.shape[0]
        spectrum[degree] = (np.bincount(offset, minlength=2 * image.shape[0]) ** 2.0).sum()
    return spectrum - spectrum.mean()


def _shift(target: np.ndarray, source: np.ndarray) -> float:
    """Shift [cells] of a profile that matches another best."""
    both = np.correlate(target - target.mean(), source - source.mean(), 'full')
    return float(both.argmax() - (len(source) - 1))


def _walls(grid: Grid, size: int, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Blurred wall image (size, size) centred on the walls, and its corner (2,) [m]."""
    points = grid.points(grid.occupied)
    corner = (points.min(0) + points.max(0)) / 2.0 - size * cell / 2.0
    place = ((points - corner) / cell).astype(int)
    place = place[((place >= 0) & (place < size)).all(1)]
    image = np.zeros((size, size), np.float32)
    image[place[:, 1], place[:, 0]] = 1.0
    return cv2.GaussianBlur(image, (0, 0), 1.0), corner


def _polar(image: np.ndarray) -> np.ndarray:
    """Power over half a turn of directions (720,)."""
    power = np.log1p(np.abs(np.fft.fftshift(np.fft.fft2(image)))).astype(np.float32)
    middle = (image.shape[1] / 2, image.shape[0] / 2)
    polar = cv2.warpPolar(power, (image.shape[0] // 2, 1440), middle, image.shape[0] / 2, 0)
    profile = polar[:, 20:].sum(1)
    return profile[:720] - profile[:720].mean()
