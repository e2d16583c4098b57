# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The colours of the figures."""

from collections.abc import Mapping, Sequence

# Okabe and Ito's colours, which colour-blind readers can tell apart.
COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9')
BOTH, FREE, UNKNOWN, WALL, PALE = '#222222', '#EEF1F4', '#FFFFFF', '#222222', '#CFD4D9'
AGREEMENT, AGREEMENT_PALE, CONFLICT, ONE = '#009E73', '#D5EFE6', '#D0021B', '#9AA3AB'


def team_colours(names: Sequence[str]) -> Mapping[str, str]:
    """Assign a colour to every robot; from the seventh on they repeat."""
    return {name: COLOURS[k % len(COLOURS)] for k, name in enumerate(names)}
