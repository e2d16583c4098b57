# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Floor plans, lasers and drives: robots with ground truth."""
