# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Every parameter, once: default, unit, range and one sentence.

The nodes declare their ROS parameters from these dataclasses, and the YAML files in `config/`
repeat them with the same words (a test compares them).
"""

from dataclasses import dataclass, field, fields
from typing import Any


def parameter(default: Any, unit: str, low: float | None, high: float | None,
              description: str) -> Any:
    """Make a dataclass field that carries its unit, range (None: open) and sentence."""
    return field(default=default, metadata={
        'unit': unit, 'low': low, 'high': high, 'description': description})


def validate(config: Any) -> None:
    """Raise ValueError, naming the parameter, if a number leaves its range."""
    for item in fields(config):
        value, low, high = getattr(config, item.name), item.metadata['low'], item.metadata['high']
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            continue
        if (low is not None and not value >= low) or (high is not None and not value <= high):
            raise ValueError(f'{item.name} = {value} is outside [{low}, {high}]')


@dataclass(frozen=True)
class SlamConfig:
    """Parameters of one robot's SLAM."""

    resolution: float = parameter(
        0.05, 'm', 0.005, 1.0, 'Edge of a map cell; smaller is finer and costs memory.')

    def __post_init__(self) -> None:
        validate(self)


@dataclass(frozen=True)
class FusionConfig:
    """Parameters of the merge of two maps."""

    method: str = parameter(
        'som', '', None, None,
        'som: many hypotheses and a calibrated verdict; paper: the literal IROS 2011 method.')
    estimation_confidence: float = parameter(
        0.95, 'probability', 0.0, 1.0,
        'A relative pose is accepted at this probability of being right.')

    def __post_init__(self) -> None:
        validate(self)
