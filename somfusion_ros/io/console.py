# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands say: lines on stdout, errors on stderr, progress on a terminal only."""

import sys
from typing import Any

from tqdm import tqdm


def say(text: str = '') -> None:
    """Write a line to stdout."""
    sys.stdout.write(text + '\n')
    sys.stdout.flush()


def complain(text: str) -> None:
    """Write one line to stderr."""
    sys.stderr.write(' '.join(text.split()) + '\n')
    sys.stderr.flush()


def progress_bar(label: str, total: int, unit: str, position: int = 0,
                 quiet: bool = False) -> Any:
    """Make a tqdm bar on stderr that is silent where stderr is no terminal."""
    return tqdm(total=total, desc=label, unit=unit, position=position, disable=quiet or None,
                dynamic_ncols=True, leave=position == 0, file=sys.stderr)
