# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a station must count of what it heard: a fault that nobody reports is a failure, too."""

from collections.abc import Iterator

from somfusion_ros.simulation.chaos.network import Delivery
from somfusion_ros.simulation.chaos.station import Station
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.channels import MAP, POSE, STATE, VIEWS
from somfusion_ros.team.heard import TUNING as CLOCKS
from somfusion_ros.team.view_store import heading

FAR = 1e5            # [m] from where on a pose is absurd
# What a station must count once it heard a lie of a kind on a channel.
SHOWN = {('garbage', STATE): 'state_of_{}_unusable', ('walls', MAP): 'map_of_{}_unusable',
         ('views', VIEWS): 'views_of_{}_unusable',
         ('poses', POSE): 'pose_of_{}_unusable'}


class Reports:
    """Counts that must not be zero in the end, by station."""

    def __init__(self) -> None:
        self._expected: dict[Station, set[str]] = {}
        self._told: dict[tuple[Station, str], tuple[Epoch, str]] = {}

    def lied(self, station: Station, kind: str, one: Delivery) -> None:
        """Note what a station must count, now that a liar told it something."""
        shown = SHOWN.get((kind, one.channel))
        if shown and (kind != 'poses' or one.message.payload[0].pose.x > FAR):
            self._expect(station, shown.format(one.sender))

    def heard(self, station: Station, one: Delivery, now: float) -> None:
        """Note what a station must count, now that an honest robot told it something."""
        if one.channel == POSE:     # a clock that is ahead of its own
            ahead = one.message.payload[0].stamp - 1e-9 * station.clock.stamp(now)
            if ahead > 2.0 * CLOCKS.ahead:
                self._expect(station, f'clock_of_{one.sender}_ahead')
        elif one.channel == VIEWS:    # a SLAM that was restarted and goes on with its map
            epoch, telling, _ = heading(one.message.payload)
            before = self._told.get((station, one.sender), (epoch, telling))
            self._told[station, one.sender] = epoch, telling
            if before[0] == epoch and before[1] != telling:
                self._expect(station, f'slam_of_{one.sender}_restarted')

    def missing(self, station: Station) -> Iterator[str]:
        """Yield what a station was to count and did not, by name."""
        yield from (name for name in sorted(self._expected.get(station, ()))
                    if not station.counts[name])

    def _expect(self, station: Station, name: str) -> None:
        self._expected.setdefault(station, set()).add(name)
