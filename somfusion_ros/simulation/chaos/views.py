# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A simulated robot's end of the elastic map: views and bonds, with the real codecs."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

from somfusion_ros.simulation.chaos.network import Delivery, Network
from somfusion_ros.simulation.chaos.records import Playing
from somfusion_ros.team.bond_message import BondTeller
from somfusion_ros.team.channels import BONDS, VIEWS
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.session import FusionSession
from somfusion_ros.team.view_inbox import ViewInbox
from somfusion_ros.team.view_store import encode_batches


class ViewEnd:
    """What slam_node tells of its path, and what fusion_node does with that of all."""

    def __init__(self, name: str, start: str, session: FusionSession,
                 heard: Mapping[str, Heard], network: Network, count: Callable[..., None],
                 clock: Callable[[], float]) -> None:
        self._name, self._session, self._network = name, session, network
        self._inbox = ViewInbox(session.elastic, heard, count, clock,
                                lambda: session.absent)
        self._telling, self._told = '', 0
        self._teller = BondTeller(start)

    def tell(self, slam: Playing, now: float) -> None:
        """Tell what is new of the path; of another map, or after a restart, all of it."""
        if slam.telling != self._telling:
            self._telling, self._told = slam.telling, 0
        come = slam.tape.come(slam.elapsed)
        for facts in slam.tape.facts[self._told:come]:
            for batch in encode_batches(slam.epoch, slam.telling, facts):
                self._inbox.keep_batch(self._name, batch)
                self._network.publish(self._name, VIEWS, batch, len(batch), now, log=True)
        if come > self._told:
            poses = slam.tape.kept[come - 1].poses
            self._session.path = poses
        self._told = come

    def want(self, peers: Collection[str], now: float) -> None:
        """Listen to the views and the bonds of some peers."""
        for peer in sorted(peers):
            for channel in (VIEWS, BONDS):
                self._network.subscribe(self._name, peer, channel, now)

    def hear(self, one: Delivery) -> None:
        """Keep what came."""
        keep: Any = self._inbox.keep_batch if one.channel == VIEWS else self._inbox.keep_bonds
        keep(one.sender, one.message.payload)

    def hear_kept(self, robot: str, data: bytes) -> None:
        """Keep what somebody handed on of a robot that is gone."""
        self._inbox.keep_kept(robot, data)

    def drain(self) -> None:
        """Hand on what came."""
        self._inbox.drain()

    def say(self, now: float) -> None:
        """Tell the bonds that this robot found, where they changed."""
        data = self._teller.more(self._session.elastic.own_bonds())
        if data is not None:
            self._network.publish(self._name, BONDS, data, len(data), now)
