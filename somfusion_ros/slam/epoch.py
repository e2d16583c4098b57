# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which map it is: what is said of a robot's map holds only while that map lives."""

import re
from typing import NamedTuple

WRITTEN = re.compile(r'([0-9a-z]{1,32})\.([0-9]{1,9})(?:\.([0-9a-z]{1,12}))?')
ALONE = re.compile(r'\.([0-9]{1,9})')   # of an offline run, which has no start
LONGEST = 42     # letters, for which map messages have room
SHORT = 12       # letters of the program that went back


class Epoch(NamedTuple):
    """
    The start of the program that began a map, and how many maps it had begun before.

    A robot that goes on with its map after a restart goes on with the map's epoch. Where it goes
    on from an earlier state than it had told, as after a crash, what was said meanwhile is of
    another map: resumed is then the start of the program that went back. An empty start is that of
    a map which has no other beside it, as in an offline run.
    """

    start: str = ''
    reset: int = 0
    resumed: str = ''

    def __str__(self) -> str:
        """Write `start.reset`, or `start.reset.resumed`."""
        return f'{self.start}.{self.reset}' + (f'.{self.resumed}' if self.resumed else '')

    @classmethod
    def parse(cls, text: object) -> 'Epoch':
        """Read what was written; ValueError on anything else, of whatever type."""
        found = WRITTEN.fullmatch(text) if isinstance(text, str) else None
        if found is None or len(found[0]) > LONGEST:
            raise ValueError(f'epoch {ascii(text)[:40]} is not like 1f3a.0')
        return cls(found[1], int(found[2]), found[3] or '')

    @classmethod
    def read(cls, text: object) -> 'Epoch':
        """Read what was written, also of a map that has no other beside it; else ValueError."""
        alone = ALONE.fullmatch(text) if isinstance(text, str) else None
        return cls(reset=int(alone[1])) if alone else cls.parse(text)

    def gone_back(self, start: str) -> 'Epoch':
        """Return the epoch of this map as a program goes on with an earlier state of it."""
        return self._replace(resumed=start[:SHORT])

    def same_map(self, other: 'Epoch') -> bool:
        """Return whether both are of one map, at whatever state it went on from."""
        return self[:2] == other[:2]
