# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is odd in what a peer says of others: it changes nothing, and is counted all the same."""

from collections.abc import Collection, Iterator

from somfusion_ros.team.state_codec import TeamState

MOST_STRANGERS = 64      # robots that a peer may name before others hear of them


def oddities(owner: str, state: TeamState, own: str, known: Collection[str]
             ) -> Iterator[tuple[str, str]]:
    """Yield what is odd in a state of a peer: a name to count it under, and a sentence."""
    named = {robot for one in state.constraints for robot in one.robots}
    strangers = named - {*known, owner, own}
    if len(strangers) > MOST_STRANGERS:
        yield (f'state_of_{owner}_names_strangers',
               f'{len(strangers)} robots that nobody heard, such as {min(strangers)}')
    if any(gone.robot == own for gone in state.departed):
        yield (f'{owner}_does_not_hear_us',
               f'it says that {own} is gone: the network lets through one way only, or it lies')
