# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
All ROS names of the package in one place: topics, services, types.

Every name is relative, so that a namespace is all that a second robot needs. Those that stand
below another robot's name are found as `/<robot>/<name>`.
"""

# One robot's SLAM.
SCAN, ODOMETRY, JOINT_STATES, IMU = 'scan', 'odom', 'joint_states', 'imu'
MAP, MAP_METADATA, ROBOT_POSE, PATH = 'map', 'map_metadata', 'pose', 'path'
GRADED_SUFFIX = '_graded'   # of the same map with graded evidence
MAP_GRADED = 'map_graded'
GLOBAL_MAP, GLOBAL_MAP_GRADED = 'global_map', 'global_map_graded'
INITIAL_POSE, DYNAMIC_MAP = 'initialpose', 'dynamic_map'
VIEWS = 'views'            # what a robot's path is made of, as a log
JOINT_PATH = 'joint_path'   # where the team's problem has the robot's own views, in world
MAP_EPOCH = 'map_epoch'    # which map it is that the other topics speak of

# The team, for those who use its results.
RELATIVE_TRANSFORMS, PEER_POSES, PEER_BODIES = 'relative_transforms', 'peer_poses', 'peer_bodies'
CLUSTERS, MARKERS, ENCOUNTERS = 'clusters', 'markers', 'encounters'
LOOKOUTS = 'lookouts'     # from where a look would settle a verdict that is ambiguous
PEERS = 'peers'   # followed by the name of a robot and by map, path or clusters

# What fusion nodes tell one another: states and poses always, maps to those who ask.
TEAM_STATE, TEAM_POSE = 'team/state', 'team/pose'
TEAM_MAP, TEAM_MAP_CHANGES = 'team/map', 'team/map_changes'
TEAM_BONDS = 'team/bonds'         # matches between the views of two robots
# Followed by the name of the robot that is gone.
TEAM_DEPARTED, TEAM_DEPARTED_VIEWS = 'team/departed', 'team/departed_views'

# Services below each node's name.
SAVE_MAP, SAVE_MAP_AS, RESET, MERGE = '~/save_map', '~/save_map_as', '~/reset', '~/merge'
SERIALIZE_MAP, DESERIALIZE_MAP = '~/serialize_map', '~/deserialize_map'
PAUSE = '~/pause_new_measurements'

# Absolute, as everywhere in ROS: remapped where a robot has a tree of its own.
TF, TF_STATIC, DIAGNOSTICS = '/tf', '/tf_static', '/diagnostics'

MAP_TYPE, STATE_TYPE = 'nav_msgs/msg/OccupancyGrid', 'std_msgs/msg/String'
