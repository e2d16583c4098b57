# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Message types of packages that a robot need not have installed."""

from importlib import import_module
from typing import Any


def message_type(module: str, name: str) -> Any:
    """Return a type such as ('nav2_msgs.srv', 'SaveMap'); None where it is not installed."""
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError):
        return None
