# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which map it is: what is said of a robot's map holds only while that map lives."""

import re
from typing import NamedTuple

WRITTEN = re.compile(r'([0-9a-z]{1,32})\.([0-9]{1,9})')


class Epoch(NamedTuple):
    """
    The start of the program that began a map, and how many maps it had begun before.

    A robot that goes on with its map after a restart goes on with the map's epoch. An empty start
    is that of a map which has no other beside it, as in an offline run.
    """

    start: str = ''
    reset: int = 0

    def __str__(self) -> str:
        """Write `start.reset`."""
        return f'{self.start}.{self.reset}'

    @classmethod
    def parse(cls, text: object) -> 'Epoch':
        """Read `start.reset`; ValueError on anything else, of whatever type."""
        found = WRITTEN.fullmatch(text) if isinstance(text, str) else None
        if found is None:
            raise ValueError(f'epoch {ascii(text)[:40]} is not like 1f3a.0')
        return cls(found[1], int(found[2]))
