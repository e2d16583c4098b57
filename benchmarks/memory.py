# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory this process has needed."""

from pathlib import Path
import re


def peak_megabytes() -> float:
    """
    Return the most memory [MB] that this process has held.

    Not `resource.getrusage`, whose figure a process inherits from the one that started it.
    """
    status = Path('/proc/self/status').read_text()
    return int(re.search(r'VmHWM:\s+(\d+) kB', status).group(1)) / 1024.0
