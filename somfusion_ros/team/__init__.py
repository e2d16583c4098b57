# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Many robots without a server: maps that arrive, pairs, the graph that places them, one map."""
