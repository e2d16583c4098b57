# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Where maps and logs come from: converters, loaders, drawn and simulated worlds."""
