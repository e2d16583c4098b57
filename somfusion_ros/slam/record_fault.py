# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Records of a checkpoint whose checksum is right, but which no SLAM of this world wrote."""

from collections.abc import Mapping

import numpy as np
from somfusion_ros.geometry import Array

FARTHEST = 1e5        # [m] of anything in a map from its origin
LARGEST = 1e12        # of any other number: stamps [s] are the largest that are
MOST_BEAMS = 100_000  # of a scan, and points of a view: ten times what lasers have
MOST_VIEWS = 1_000_000
WIDEST = 1e8          # [m^2, rad^2] variance of anything that is known
MATRICES = ('R', 'P', 'P_turning', 'P_travelling')
LENGTHS = ('ends', 'reach', 'origin', 'points', 'pose', 'poses', 'T_view_base')
SCANNED = ('ends', 'reach', 'points', 'normals')
COUNTED = ('k', 'n', 'view', 'views', 'first', 'numbers', 'to_close', 'around', 'fresh')
SINGLE = ('k', 'n', 'view', 'first', 'stamp')
POSITIVE = ('reach', 'scatter', *COUNTED)


def record_fault(arrays: Mapping[str, Array]) -> str:
    """Return what is absurd in a record, by name and in few words; '' if nothing is."""
    for name, array in arrays.items():
        if array.dtype.kind not in ('iu' if name in COUNTED else 'fiub') or (
                not np.isfinite(array).all()):
            return f'{name} that are no numbers'
        low, high = array.min(initial=0), array.max(initial=0)
        largest = FARTHEST if name in LENGTHS else LARGEST
        if low < (0 if name in POSITIVE else -largest) or high > largest:
            return f'{name} beyond all measure'
        if len(np.atleast_1d(array)) > (MOST_BEAMS if name in SCANNED else MOST_VIEWS):
            return f'too many {name}'
        if name in MATRICES and not _is_covariance(array, name == 'R'):
            return f'{name} that is no covariance'
        if name in SINGLE and array.shape != ():
            return f'more than one {name}'
    fits = 'hit' not in arrays or arrays['hit'].shape == (-(-len(arrays['reach']) // 8),)
    return '' if fits else 'hits that do not fit the beams'


def _is_covariance(matrix: Array, inverted: bool) -> bool:
    """Tell whether a matrix is symmetric and no variance is below 0, or 0 if it is inverted."""
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or (
            not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12)):
        return False
    variances = np.linalg.eigvalsh(matrix)
    least = 1e-16 if inverted else -1e-9 * max(variances[-1], 1.0)
    return bool(least <= variances[0] and variances[-1] <= WIDEST)
