# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How a setting is written down: default, unit, range and one sentence, once.

Each room has its settings in frozen dataclasses of such fields. The nodes declare their ROS
parameters from them, and the YAML files in `config/` repeat them with the same words (a test
compares them). The numbers that a stage was tuned with, which no user sets, stand in a frozen
dataclass beside the stage.
"""

from dataclasses import field, fields
from typing import Any


def parameter(default: Any, unit: str, low: float | None, high: float | None,
              description: str, live: bool = False, words: bool = False) -> Any:
    """
    Make a dataclass field that carries its unit, range (None: open) and sentence.

    live: a node takes changes of it while it runs, even where its class is read at the start;
    words: a list of words, which may come as one text, separated by blanks or commas.
    """
    return field(default=default, metadata={
        'unit': unit, 'low': low, 'high': high, 'description': description, 'live': live,
        'words': words})


def validate(config: Any) -> None:
    """Raise ValueError, naming the parameter, if a number leaves its range."""
    for item in fields(config):
        value, low, high = getattr(config, item.name), item.metadata['low'], item.metadata['high']
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        if (low is not None and not value >= low) or (high is not None and not value <= high):
            raise ValueError(f'{item.name} = {value} is outside [{low}, {high}]')


def tuned(value: Any, unit: str, reason: str, measured: str) -> Any:
    """
    Make a dataclass field for a number that was found by trying, not one that a user sets.

    Parameters
    ----------
    value : the number, or a tuple of numbers
    unit : its unit; '' for a share, a count or a power
    reason : what it does, and what goes wrong where it is larger or smaller
    measured : the benchmark, data or document where it was found; `by design` where it follows
        from something else, `not measured` where nobody has tried others
    """
    return field(default=value, metadata={'unit': unit, 'reason': reason, 'measured': measured})
