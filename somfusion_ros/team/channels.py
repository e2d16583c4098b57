# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
The channels on which robots hear one another.

On ROS each is a topic below the robot's name (`ros/common/names.py`); in a simulation it is
whatever carries bytes.
"""

STATE, POSE, CLUSTERS = 'state', 'pose', 'clusters'
VIEWS, BONDS = 'views', 'bonds'
MAP, CHANGES = 'map stream', 'map changes'
PLAIN_MAP, TRANSFORMS = 'map', 'transforms'   # of a robot without a fusion node
MAP_CHANNELS = (PLAIN_MAP, MAP, CHANGES)
