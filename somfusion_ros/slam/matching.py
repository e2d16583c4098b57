# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Scan to local map: kiss-icp's registration, then point to line with an honest covariance.

kiss-icp (Vizzo et al. 2023) brings the scan near; it is built for 3-D and gives neither a
covariance nor a measure of success. The point-to-line refinement after it (Censi 2008) gives
both: the information matrix comes from the matched surface normals, so that a corridor, whose
normals all point one way, says nothing along itself.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

from kiss_icp.pybind import kiss_icp_pybind
import numpy as np
from somfusion_ros.geometry import Array, difference, rotation, wrap
from somfusion_ros.settings import tuned
from somfusion_ros.slam.local_map import lift, LocalMap
from somfusion_ros.slam.scan import Cloud


@dataclass(frozen=True)
class MatchingTuning:
    """Gates and noise of the registration."""

    coarse_gate: float = tuned(
        0.5, 'm', 'of correspondences in kiss-icp', 'shared logs')
    coarse_kernel: float = tuned(
        0.15, 'm', 'of its robust kernel', 'shared logs')
    gates: tuple[float, float, float] = tuned(
        (0.25, 0.12, 0.10), 'm', 'of correspondences in the refinement, narrowing',
        'shared logs')
    same_side: float = tuned(
        0.5, 'cosine', 'normals that differ more are another surface', 'by design')
    range_sigma: float = tuned(
        0.02, 'm', 'of one matched point, for the hold on the seed', 'not measured')
    least_sigma: float = tuned(
        0.005, 'm', 'of one matched point, however smooth the scan',
        'benchmarks/slam/covariance.py')
    oversampling: float = tuned(
        5.0, 'points', 'neighbours that share their error', 'benchmarks/slam/covariance.py')
    correlated: float = tuned(
        0.2, 'm', 'of surface along which they do', 'benchmarks/slam/covariance.py')
    normal_sigma: float = tuned(
        0.10, 'rad', 'of an estimated normal', 'benchmarks/slam/covariance.py')
    floor: tuple[float, float, float] = tuned(
        (0.001, 0.001, 0.0005), 'm, m, rad', 'sigmas of any match', 'not measured')
    quality: int = tuned(
        4, 'power', 'of the inlier ratio by which a match that fits in part is doubted',
        'benchmarks/slam/covariance.py')


TUNING = MatchingTuning()
FEWEST = 8   # points that can be matched
FLOOR = np.diag(TUNING.floor) ** 2


@dataclass(frozen=True, eq=False)
class Match:
    """
    Where a scan lies in a local map.

    T_map_scan (3,), information (3, 3) of it (singular where the surface fixes nothing), the
    share of the scan's points that lie on the map's surface, and the root [m] of their mean
    squared distance from it.
    """

    T_map_scan: Array
    information: Array
    inlier_ratio: float
    residual: float

    @cached_property
    def covariance(self) -> Array:
        """Covariance (3, 3); very large along what the match does not fix."""
        return np.linalg.inv(self.information + 1e-6 * np.eye(3))


def coarse(scan: Cloud, target: LocalMap, seed: Array) -> Array:
    """Register with kiss-icp from a seed (3,); planar points keep z, roll and pitch at 0."""
    guess = np.eye(4)
    guess[:2, :2], guess[:2, 3] = rotation(seed[2]), seed[:2]
    registration = kiss_icp_pybind._Registration(
        max_num_iterations=20, convergence_criterion=1e-3, max_num_threads=1)
    T = registration._align_points_to_map(
        points=lift(scan.points), voxel_map=target.voxels, initial_guess=guess,
        max_correspondance_distance=TUNING.coarse_gate, kernel=TUNING.coarse_kernel)
    return np.array([T[0, 3], T[1, 3], np.arctan2(T[1, 0], T[0, 0])])


def refine(scan: Cloud, target: LocalMap, seed: Array, hold: Array | None = None) -> Match:
    """
    Refine a seed (3,) by point-to-line Gauss-Newton.

    hold is information (3, 3) that keeps the pose at the seed where the surface fixes nothing;
    it is not part of the information returned.
    """
    if not len(target):
        return _unmatched(seed)
    x = np.array(seed, dtype=float)
    scale = TUNING.oversampling * TUNING.range_sigma ** 2
    prior = 1e-6 * np.eye(3) + (0.0 if hold is None else hold)
    for gate in TUNING.gates:
        turn = complex(cos(x[2]), sin(x[2]))   # of vectors in the plane as complex numbers
        arm, own = scan.plane * turn, scan.facing * turn
        p = arm + complex(x[0], x[1])
        distance, nearest = target.tree.query(p.view(float).reshape(-1, 2),
                                              distance_upper_bound=gate)
        found = distance < gate
        nearest[~found] = 0
        n = np.where(target.bare.take(nearest), own, target.facing.take(nearest)).conj()
        found &= ((n * own).real > TUNING.same_side) | scan.bare
        inliers = np.count_nonzero(found)
        if inliers < FEWEST:
            return _unmatched(x)
        e = (n * (p - target.plane.take(nearest))).real
        w = found / (1.0 + (e / (0.3 * gate)) ** 2) ** 2
        J = _jacobian(n, arm)
        JtW = J * w
        H = JtW @ J.T
        gradient = JtW @ e / scale
        if hold is not None:
            gradient += hold @ difference(x, seed)
        x = x - np.linalg.solve(H / scale + prior, gradient)
    ratio, residual = inliers / len(found), float(np.sqrt(w @ (e * e) / max(w.sum(), 1e-9)))
    x[2] = wrap(x[2])
    H = _without_false_information(H, _jacobian(-1j * n, arm), w)
    # The distance to the nearest of many points hides the noise; the scan's own scatter shows it.
    shared = min(max(TUNING.correlated / scan.spacing, 1.0), TUNING.oversampling)
    sigma2 = shared * max(TUNING.least_sigma, scan.noise, residual) ** 2
    sigma2 /= max(ratio, 0.3) ** TUNING.quality
    information = H / sigma2
    information = information @ np.linalg.inv(np.eye(3) + FLOOR @ information)
    return Match(x, 0.5 * (information + information.T), ratio, residual)


def _jacobian(conjugates: Array, arm: Array) -> Array:
    """Differentiate (3, N) the distances along normals, conjugates of (N,), of points at arm."""
    return np.array([conjugates.real, -conjugates.imag, -(conjugates * arm).imag])


def _without_false_information(H: Array, J_tangent: Array, w: Array) -> Array:
    """
    Take out of H (3, 3) what only the noise of the normals puts in.

    A normal that is off by a small angle a claims sin(a)^2 of a point's information along the
    surface. Along a corridor these claims add up to a match that is sure of what it cannot see.
    """
    true = H - TUNING.normal_sigma ** 2 * (J_tangent * w) @ J_tangent.T
    values, vectors = np.linalg.eigh(true)
    return true if values[0] >= 0.0 else (vectors * np.maximum(values, 0.0)) @ vectors.T


def register(scan: Cloud, target: LocalMap, seed: Array, hold: Array | None = None) -> Match:
    """
    Register with kiss-icp from the seed (3,), then refine.

    A seed that is not finite matches nothing: kiss-icp would end the whole process over it.
    """
    if min(len(scan), len(target)) < FEWEST or not np.isfinite(seed).all():
        return _unmatched(seed)
    return refine(scan, target, coarse(scan, target, seed), hold)


def _unmatched(pose: Array) -> Match:
    """Return a match that explains nothing, at a pose (3,)."""
    return Match(np.array(pose, dtype=float), np.zeros((3, 3)), 0.0, np.inf)
