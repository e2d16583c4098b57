# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service by name (REP-2003), overridable from YAML through `qos_overrides`."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

# Best effort, as every sensor driver can satisfy; deep enough for 1 s of fast odometry, so that
# a moment of load in a Python node loses nothing.
SENSOR_DATA = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

# Reliable and kept for late joiners: maps and what is true until replaced.
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)

# One accepted transform per peer is kept for late joiners; a team is never larger than this.
LATCHED_PER_PAIR = QoSProfile(depth=64, reliability=ReliabilityPolicy.RELIABLE,
                              durability=DurabilityPolicy.TRANSIENT_LOCAL)

# A log of which nobody may miss anything, late joiners neither.
LOG = QoSProfile(depth=4096, reliability=ReliabilityPolicy.RELIABLE,
                 durability=DurabilityPolicy.TRANSIENT_LOCAL)

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)

LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)

# What tf2_ros uses for /tf and /tf_static.
TRANSFORMS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
STATIC_TRANSFORMS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE,
                               durability=DurabilityPolicy.TRANSIENT_LOCAL)

# What a recorded log is played with: reliable and deep, so that nothing is lost.
REPLAY = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)


def overridable() -> QoSOverridingOptions:
    """Return options with which `qos_overrides.<topic>...` parameters change the profile."""
    return QoSOverridingOptions.with_default_policies()
