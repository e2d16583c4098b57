# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Figures: of maps, of pairs, of a team, and of the team live in a terminal."""
