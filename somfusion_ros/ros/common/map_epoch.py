# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
How slam_node tells which map it is that its topics speak of.

`map_epoch` names the epoch, and a time that `info.map_load_time` of every map of this epoch
carries as well: so that no latched map of an earlier epoch is taken for one of this.
"""

import json
from typing import NamedTuple

from builtin_interfaces.msg import Time
from somfusion_ros.slam.epoch import Epoch
from std_msgs.msg import String

VERSION = 1
LONGEST = 200    # letters of a message


class MapEpoch(NamedTuple):
    """An epoch, and the load time that its maps carry."""

    epoch: Epoch
    loaded: Time

    def message(self) -> String:
        """Write it."""
        return String(data=json.dumps({'version': VERSION, 'epoch': str(self.epoch),
                                       'loaded': [self.loaded.sec, self.loaded.nanosec]}))

    @classmethod
    def from_message(cls, message: String) -> 'MapEpoch':
        """Read it; ValueError with one line on anything else."""
        if len(message.data) > LONGEST:
            raise ValueError(f'map epoch of {len(message.data)} letters is over {LONGEST}')
        try:
            record = json.loads(message.data)
            if record['version'] != VERSION:
                raise ValueError(f'map epoch of version {str(record["version"])[:20]}')
            seconds, nanoseconds = record['loaded']
            return cls(Epoch.parse(record['epoch']), Time(sec=seconds, nanosec=nanoseconds))
        except (KeyError, TypeError, AttributeError, RecursionError, AssertionError,
                OverflowError) as error:
            raise ValueError(f'not a map epoch: {error!r}') from error
