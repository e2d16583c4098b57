# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""fusion_node: the team's maps in, relative transforms and a global map out."""
