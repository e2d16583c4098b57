# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Runs over recorded data, without a ROS graph: replay and merge."""
