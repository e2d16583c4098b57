# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How trajectories, pairs of maps and teams are scored."""
