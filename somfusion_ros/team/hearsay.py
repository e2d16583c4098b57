# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is odd in what a peer says, and when: it changes nothing, and is counted all the same."""

from collections.abc import Collection, Iterator

from somfusion_ros.team.heard import TUNING as HEARING
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


def odd_times(names: tuple[str, str], stamp: float, late: float, ahead: float, now: float
              ) -> Iterator[tuple[str, str]]:
    """
    Yield that a pose of a peer came late, or its clock is ahead, or the listener's own SLAM slow.

    names: the peer's and the listener's; stamp [s] of the pose, late and ahead [s] of the
    listener's newest; now [s] of the clock that stamps the listener's messages, nan if unknown.
    """
    peer, own = names
    if late > HEARING.tardy:
        yield f'pose_of_{peer}_late', f'by {late:.1f} s: a slow network, or its clock'
    if ahead and stamp <= now + HEARING.ahead:
        yield f'pose_of_{own}_late', f'by {ahead:.1f} s: the own SLAM is slow'
    elif ahead:
        yield f'clock_of_{peer}_ahead', f'by {ahead:.1f} s: it was set, or drifts'
