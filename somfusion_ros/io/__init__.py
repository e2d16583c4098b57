# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Files: bags, saved maps, trajectories, parameter files and results."""
