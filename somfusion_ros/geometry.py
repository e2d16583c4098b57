# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Rigid motions of the plane, SE(2).

A pose is three numbers x [m], y [m], theta [rad], counter-clockwise positive, written
`T_target_source`: it takes points of the source frame into the target frame. All functions
take a `Pose` or arrays whose last axis holds (x, y, theta), and broadcast over leading axes.
Most calls are about a single pose, for which plain numbers are several times faster than arrays.
"""

from collections.abc import Iterable
from math import cos, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]   # of numbers; most are double precision, images and grids single


class Pose(NamedTuple):
    """One rigid motion; a drop-in for an array of shape (3,)."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    @classmethod
    def from_array(cls, values: Iterable[float]) -> 'Pose':
        """Make a pose of three numbers; ValueError unless all are finite."""
        x, y, theta = (float(v) for v in values)
        if not np.isfinite((x, y, theta)).all():
            raise ValueError(f'pose is not finite: ({x}, {y}, {theta})')
        return cls(x, y, float(wrap(theta)))


def wrap(angle: ArrayLike) -> Array:
    """Wrap angles [rad] into [-pi, pi)."""
    if not isinstance(angle, float):
        angle = np.asarray(angle, dtype=float)
    wrapped: Array = (angle + pi) % (2.0 * pi) - pi
    return wrapped


def rotation(theta: ArrayLike) -> Array:
    """Return the rotation matrices (..., 2, 2) of angles (...) [rad]."""
    if isinstance(theta, float):
        c, s = cos(theta), sin(theta)
        return np.array(((c, -s), (s, c)))
    c, s = np.cos(theta), np.sin(theta)
    R = np.empty((*np.shape(c), 2, 2))
    R[..., 0, 0], R[..., 0, 1], R[..., 1, 0], R[..., 1, 1] = c, -s, s, c
    return R


def compose(T_a_b: ArrayLike, T_b_c: ArrayLike) -> Array:
    """
    Return T_a_c = T_a_b * T_b_c, shape (..., 3).

    >>> compose((1.0, 0.0, np.pi / 2.0), (2.0, 0.0, 0.0)).round(3).tolist()
    [1.0, 2.0, 1.571]
    """
    a, b = np.asarray(T_a_b, dtype=float), np.asarray(T_b_c, dtype=float)
    if a.ndim == b.ndim == 1:
        (x, y, theta), (u, v, turn) = a.tolist(), b.tolist()
        c, s = cos(theta), sin(theta)
        return np.array((x + c * u - s * v, y + s * u + c * v, wrap(theta + turn)))
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _pose(a[..., 0] + c * b[..., 0] - s * b[..., 1],
                 a[..., 1] + s * b[..., 0] + c * b[..., 1], a[..., 2] + b[..., 2])


def _pose(x: Array, y: Array, theta: Array) -> Array:
    """Return poses (..., 3) of their parts; numpy's own stack is slow for a single pose."""
    pose = np.empty((*np.shape(x), 3))
    pose[..., 0], pose[..., 1], pose[..., 2] = x, y, wrap(theta)
    return pose


def inverse(T_a_b: ArrayLike) -> Array:
    """Return T_b_a, shape (..., 3)."""
    a = np.asarray(T_a_b, dtype=float)
    if a.ndim == 1:
        x, y, theta = a.tolist()
        c, s = cos(theta), sin(theta)
        return np.array((-c * x - s * y, s * x - c * y, wrap(-theta)))
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return _pose(-c * a[..., 0] - s * a[..., 1], s * a[..., 0] - c * a[..., 1], -a[..., 2])


def between(T_w_a: ArrayLike, T_w_b: ArrayLike) -> Array:
    """Return T_a_b, the pose of b seen from a, shape (..., 3)."""
    return compose(inverse(T_w_a), T_w_b)


def difference(a: Array, b: Array) -> Array:
    """Return the residual a - b (3,) of two poses in one frame, its angle wrapped."""
    d = a - b
    d[2] = wrap(d[2])
    return d


def apply(T_target_source: ArrayLike, points: ArrayLike) -> Array:
    """Transform points (N, 2) [m] of the source frame into the target frame."""
    pose = np.asarray(T_target_source, dtype=float)
    moved: Array = np.asarray(points, dtype=float) @ rotation(pose[2]).T + pose[:2]
    return moved


def place(poses: Array, points: Array) -> NDArray[np.float32]:
    """Transform points (K, 2) of the source into the target by each of poses (B, 3): (2, B, K)."""
    x, y, theta = np.asarray(poses, dtype=float).T
    c, s = np.cos(theta), np.sin(theta)
    # One matrix product: several times faster than sums and products one by one.
    matrix = np.array([[c, -s, x], [s, c, y]], np.float32).transpose(0, 2, 1).reshape(-1, 3)
    flat = np.concatenate([points.T, np.ones((1, len(points)))], dtype=np.float32)
    return (matrix @ flat).reshape(2, len(c), len(points))


def compose_jacobians(T_a_b: ArrayLike, T_b_c: ArrayLike) -> tuple[Array, Array]:
    """Return the Jacobians (3, 3) of `compose` in its first and its second argument."""
    _, _, theta = np.asarray(T_a_b, dtype=float).tolist()
    u, v, _ = np.asarray(T_b_c, dtype=float).tolist()
    c, s = cos(theta), sin(theta)
    first = np.array(((1.0, 0.0, -s * u - c * v), (0.0, 1.0, c * u - s * v), (0.0, 0.0, 1.0)))
    return first, np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))


def between_jacobians(T_w_a: ArrayLike, T_w_b: ArrayLike) -> tuple[Array, Array]:
    """Return the Jacobians (..., 3, 3) of `between` in its first and its second argument."""
    a, b = np.asarray(T_w_a, dtype=float), np.asarray(T_w_b, dtype=float)
    if a.ndim == b.ndim == 1:
        (x, y, theta), (u, v, _) = a.tolist(), b.tolist()
        c, s, dx, dy = cos(theta), sin(theta), u - x, v - y
        return (np.array(((-c, -s, c * dy - s * dx), (s, -c, -c * dx - s * dy), (0.0, 0.0, -1.0))),
                np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))))
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    second = np.zeros((*c.shape, 3, 3))
    second[..., 0, 0], second[..., 0, 1] = c, s
    second[..., 1, 0], second[..., 1, 1], second[..., 2, 2] = -s, c, 1.0
    first = -second
    first[..., 0, 2] = -s * dx + c * dy
    first[..., 1, 2] = -c * dx - s * dy
    return first, second


def squared_mahalanobis(y: Array, S: Array) -> float:
    """Return y' inv(S) y of a vector y (3,) and a positive definite covariance S (3, 3)."""
    (a, b, c), (_, d, e), (_, _, f) = S.tolist()
    y0, y1, y2 = y.tolist()
    p, q = b / a, c / a                       # S = L D L', solved forward
    d -= p * b
    r = (e - q * b) / d
    f -= q * c + r * r * d
    y1 -= p * y0
    y2 -= q * y0 + r * y1
    return float(y0 * y0 / a + y1 * y1 / d + y2 * y2 / f)


def fit(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> Pose:
    """
    Return the least-squares T_target_source of matched points.

    Parameters
    ----------
    source, target : (N, 2) array of float
        Matched points [m], N >= 2.
    weights : (N,) array of float, optional
        Not negative; one each by default.

    Raises
    ------
    ValueError
        Where the sets differ in size or hold fewer than two points.

    References
    ----------
    S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", PAMI 1991; without its scale.
    """
    p, q = np.asarray(source, dtype=float), np.asarray(target, dtype=float)
    if p.shape != q.shape or p.ndim != 2 or p.shape[1] != 2 or len(p) < 2:
        raise ValueError(f'two equal sets of at least two points needed, got {p.shape}, {q.shape}')
    w = np.ones(len(p)) if weights is None else np.asarray(weights, dtype=float)
    w = w / w.sum()
    p_mean, q_mean = w @ p, w @ q
    a, b = p - p_mean, q - q_mean
    theta = np.arctan2(w @ (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), w @ (a * b).sum(1))
    x, y = q_mean - rotation(theta) @ p_mean
    return Pose(float(x), float(y), float(theta))
