# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""How facts are unpacked: handed in, so that a simulation need not unpack the same ones again."""

from collections.abc import Sequence

from somfusion_ros.slam.constraint import Constraint
from somfusion_ros.slam.scan import Cloud
from somfusion_ros.team.beam_code import decode_beams
from somfusion_ros.team.bond_codec import decode_bonds, ToldBond
from somfusion_ros.team.fact import corners_in, Fact, unpack_facts
from somfusion_ros.team.joint import settled
from somfusion_ros.team.view_facts import decode_constraint, decode_scan, decode_view, ViewFact
from somfusion_ros.team.view_set import DrawnScan, ViewSet


class FactReader:
    """Unpacks what a robot tells of its path; ValueError where it is damaged or absurd."""

    def facts(self, packed: bytes) -> list[Fact]:
        """Take a batch apart into its facts."""
        return unpack_facts(packed)

    def view(self, fact: Fact) -> ViewFact:
        """Unpack a view."""
        return decode_view(fact)

    def cloud(self, beams: Sequence[int], outline: bytes) -> Cloud:
        """Unpack the beams of a view."""
        return decode_beams(beams, corners_in(outline))

    def loop(self, fact: Fact) -> Constraint:
        """Unpack a constraint between two views."""
        return decode_constraint(fact)

    def scan(self, fact: Fact) -> DrawnScan:
        """Unpack a scan that is only drawn."""
        return decode_scan(fact)

    def bonds(self, data: bytes, author: str) -> list[ToldBond]:
        """Unpack the bonds that an author tells."""
        return decode_bonds(data, author)

    def settled(self, views: ViewSet) -> ViewSet:
        """Return views where their own constraints have them."""
        return settled(views)
