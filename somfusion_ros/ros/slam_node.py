# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m somfusion_ros.ros.slam_node`: the process of a slam_node."""

from somfusion_ros.ros.start import slam_node

if __name__ == '__main__':
    raise SystemExit(slam_node())
