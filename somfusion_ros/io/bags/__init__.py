# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded logs: rosbag1, and rosbag2 in sqlite3 or mcap."""
