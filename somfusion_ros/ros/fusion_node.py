# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`python -m somfusion_ros.ros.fusion_node`: the process of a fusion_node."""

from somfusion_ros.ros.start import fusion_node

if __name__ == '__main__':
    raise SystemExit(fusion_node())
