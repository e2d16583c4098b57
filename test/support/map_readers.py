# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How the consumers of nav_msgs/OccupancyGrid read a cell, written anew from their rules.

Each returns an array (H, W) of the words WALL, FREE, UNKNOWN.
"""

from nav_msgs.msg import OccupancyGrid
import numpy as np
from numpy.typing import NDArray

WALL, FREE, UNKNOWN = 'wall', 'free', 'unknown'


def cells(message: OccupancyGrid) -> NDArray[np.int8]:
    """Cells (H, W) of a message."""
    return np.frombuffer(message.data, np.int8).reshape(message.info.height, message.info.width)


def static_layer(message: OccupancyGrid, lethal_cost_threshold: int = 100) -> NDArray[np.str_]:
    """Nav2's static layer at its defaults: unknown is tracked, costs are trinary."""
    values = cells(message)
    read = np.where(values.astype(np.uint8) >= lethal_cost_threshold, WALL, FREE)
    return np.where(values == -1, UNKNOWN, read)


def amcl(message: OccupancyGrid) -> NDArray[np.str_]:
    """Nav2's AMCL."""
    values = cells(message)
    return np.where(values == 0, FREE, np.where(values == 100, WALL, UNKNOWN))


def explore_lite(message: OccupancyGrid) -> NDArray[np.str_]:
    """explore_lite's costmap client: 100 is lethal, 0 is free, what is between costs something."""
    values = cells(message)
    return np.where(values == 0, FREE, np.where(values == -1, UNKNOWN, WALL))
