# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Ed25519 signatures (RFC 8032), for the little that robots sign: one takes about a millisecond.

Numbers are Python's, whose time depends on their values: who can measure a node to the microsecond
is on its computer anyway.
"""

from functools import lru_cache
from hashlib import sha512

PRIME = 2 ** 255 - 19                                     # of the field
ORDER = 2 ** 252 + 27742317777372353535851937790883648493   # of the base point
CURVE = -121665 * pow(121666, -1, PRIME) % PRIME          # d in -x^2 + y^2 = 1 + d x^2 y^2
ROOT = pow(2, (PRIME - 1) // 4, PRIME)                    # of -1
KEY, SIGNATURE = 32, 64                                   # bytes
WINDOW = 4                                                # bits of a factor that are taken at once

Point = tuple[int, int, int, int]     # X, Y, Z, T with x = X / Z, y = Y / Z, x y = T / Z
NOTHING: Point = 0, 1, 1, 0


@lru_cache(maxsize=64)
def public_key(secret: bytes) -> bytes:
    """Return the public key (32 bytes) of a secret one (32 bytes)."""
    return _packed(_of_base(_expanded(secret)[0]))


def sign(secret: bytes, message: bytes) -> bytes:
    """Return the signature (64 bytes) of a message by a secret key (32 bytes)."""
    factor, prefix = _expanded(secret)
    key = public_key(secret)
    nonce = _hashed(prefix, message)
    point = _packed(_of_base(nonce))
    return point + ((nonce + _hashed(point, key, message) * factor) % ORDER).to_bytes(32, 'little')


def verify(key: bytes, message: bytes, signature: bytes) -> bool:
    """Return whether a signature of a message is by who has the secret of a public key."""
    if len(key) != KEY or len(signature) != SIGNATURE:
        return False
    owner, point = _unpacked(key), _unpacked(signature[:32])
    factor = int.from_bytes(signature[32:], 'little')
    if owner is None or point is None or factor >= ORDER:
        return False
    expected = _sum(point, _times(_hashed(signature[:32], key, message), owner))
    return _packed(_of_base(factor)) == _packed(expected)


def _expanded(secret: bytes) -> tuple[int, bytes]:
    """Return the factor of a secret key, and what makes its nonces."""
    if len(secret) != KEY:
        raise ValueError(f'a secret key has {KEY} bytes, not {len(secret)}')
    digest = sha512(secret).digest()
    factor = int.from_bytes(digest[:32], 'little')
    return factor & (1 << 254) - 8 | 1 << 254, digest[32:]


def _hashed(*parts: bytes) -> int:
    """Hash bytes to a factor."""
    return int.from_bytes(sha512(b''.join(parts)).digest(), 'little') % ORDER


def _sum(one: Point, other: Point) -> Point:
    """Add two points (Hisil et al., "Twisted Edwards curves revisited", 2008)."""
    a = (one[1] - one[0]) * (other[1] - other[0]) % PRIME
    b = (one[1] + one[0]) * (other[1] + other[0]) % PRIME
    c = 2 * CURVE * one[3] * other[3] % PRIME
    d = 2 * one[2] * other[2] % PRIME
    e, f, g, h = b - a, d - c, d + c, b + a
    return e * f % PRIME, g * h % PRIME, f * g % PRIME, e * h % PRIME


def _times(factor: int, point: Point) -> Point:
    """Add a point to itself so many times."""
    result = NOTHING
    while factor:
        if factor & 1:
            result = _sum(result, point)
        point, factor = _sum(point, point), factor >> 1
    return result


def _of_base(factor: int) -> Point:
    """Add the base point to itself so many times, by a table."""
    result = NOTHING
    for row in _table():
        result = _sum(result, row[factor % (1 << WINDOW)])
        factor >>= WINDOW
    return result


@lru_cache(maxsize=1)      # made where it is needed first, in 10 ms
def _table() -> list[list[Point]]:
    """Return multiples of the base point: 0 to 15 times 16 to the power of the row."""
    base = _unpacked((4 * pow(5, -1, PRIME) % PRIME).to_bytes(32, 'little'))
    assert base is not None
    rows = []
    for _ in range(256 // WINDOW):
        row = [NOTHING]
        for _ in range((1 << WINDOW) - 1):
            row.append(_sum(row[-1], base))
        rows.append(row)
        base = _sum(row[-1], base)
    return rows


def _packed(point: Point) -> bytes:
    """Write a point: y, and the lowest bit of x."""
    scale = pow(point[2], -1, PRIME)
    x, y = point[0] * scale % PRIME, point[1] * scale % PRIME
    return (y | (x & 1) << 255).to_bytes(32, 'little')


def _unpacked(data: bytes) -> Point | None:
    """Read a point; None where it is not on the curve."""
    y, odd = int.from_bytes(data, 'little') & (1 << 255) - 1, data[31] >> 7
    if y >= PRIME:
        return None
    square = (y * y - 1) * pow(CURVE * y * y + 1, -1, PRIME) % PRIME
    x = pow(square, (PRIME + 3) // 8, PRIME)
    if x * x % PRIME != square:
        x = x * ROOT % PRIME
    if x * x % PRIME != square or (not x and odd):
        return None
    x = PRIME - x if x & 1 != odd else x
    return x, y, 1, x * y % PRIME
