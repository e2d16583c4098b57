# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Decentralised multi-robot 2-D SLAM: EKF mapping per robot, SOM map fusion between robots."""

import logging

__version__ = '0.1.0'

logging.getLogger(__name__).addHandler(logging.NullHandler())
