# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Whole teams in one process, with every fault that one seed chooses: no ROS, no wall time."""
