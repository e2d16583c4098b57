# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Several robots: from occupancy grids with unknown relative poses to one global map."""
