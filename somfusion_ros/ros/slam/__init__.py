# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""slam_node: one robot's scans and odometry in, its map, pose and path out."""
