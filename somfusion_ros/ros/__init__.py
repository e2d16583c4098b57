# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 shell: nodes that convert, call the core, and publish."""
