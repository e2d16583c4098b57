# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Ed25519 signatures (RFC 8032) of bytes, by the package cryptography."""

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import (Ed25519PrivateKey,
                                                               Ed25519PublicKey)
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

KEY, SIGNATURE = 32, 64    # bytes


def public_key(secret: bytes) -> bytes:
    """Return the public key (32 bytes) of a secret one (32 bytes); ValueError if it is none."""
    public = Ed25519PrivateKey.from_private_bytes(secret).public_key()
    return public.public_bytes(Encoding.Raw, PublicFormat.Raw)


def sign(secret: bytes, message: bytes) -> bytes:
    """Return the signature (64 bytes) of a message by a secret key (32 bytes)."""
    return Ed25519PrivateKey.from_private_bytes(secret).sign(message)


def verify(key: bytes, message: bytes, signature: bytes) -> bool:
    """Return whether a signature of a message is by who has the secret of a public key."""
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, message)
    except (InvalidSignature, ValueError):
        return False
    return True
