# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What both nodes share: messages, quality of service, TF, parameters, diagnostics."""
