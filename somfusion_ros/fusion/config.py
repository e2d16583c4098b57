# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the merge of two maps."""

from dataclasses import dataclass

from somfusion_ros.settings import parameter, validate


@dataclass(frozen=True)
class FusionConfig:
    """Parameters of the merge of two maps."""

    method: str = parameter(
        'som', '', None, None,
        'som: many hypotheses and a calibrated verdict; paper: the literal IROS 2011 method.',
        among=('som', 'paper'))
    estimation_confidence: float = parameter(
        0.9, 'probability', 0.0, 1.0,
        'A relative pose is accepted at this probability of being right.')
    segment_radius: float = parameter(
        0.15, 'm', 0.01, 2.0,
        'Wall cells at most this far apart are one segment; raise it for sparse scans.')
    cluster_spacing: float = parameter(
        0.4, 'm', 0.05, 5.0,
        'Distance of neighbouring clusters along a wall; smaller is finer and slower.')
    presentation_step: float = parameter(
        0.1, 'evidence', 0.01, 1.0,
        'A wall cell is presented |C| / step times, so that sure cells pull more.')
    vote_cell: float = parameter(
        0.5, 'm', 0.1, 5.0, 'Edge of the cells in which cluster pairs vote for a shift.')
    seeds: int = parameter(
        14, 'seeds', 1, 200, 'Shifts that are tried for each hypothesis of the orientation.')
    finalists: int = parameter(
        8, 'poses', 2, 50, 'Distinct poses that are settled with all clusters and judged.')

    def __post_init__(self) -> None:
        validate(self)
