# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""One robot: from scans and odometry to an occupancy grid, by a delayed-state EKF."""
