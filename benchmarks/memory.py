# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How much memory this process has needed, and how much a process holds."""

from pathlib import Path
import re
import resource


def peak_megabytes() -> float:
    """
    Return the most memory [MB] that this process has held.

    Not `resource.getrusage`, whose figure a process inherits from the one that started it.
    """
    status = Path('/proc/self/status').read_text()
    return int(re.search(r'VmHWM:\s+(\d+) kB', status).group(1)) / 1024.0


def held_bytes(process: int | None = None) -> int:
    """Return the resident memory [bytes] of a process, by its id; of this one where None."""
    sizes = Path(f'/proc/{process or "self"}/statm').read_text().split()
    return int(sizes[1]) * resource.getpagesize()
