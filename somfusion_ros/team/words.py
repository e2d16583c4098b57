# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts and numbers as a user reads them in the log."""

LAPSED = ('initial_poses says where the first map of {robot} lies, and it has another one now, as '
          'it was started anew without its map; it may stand elsewhere, so its map is matched. If '
          'it does stand there, call ~/reset of fusion_node on every robot')


def sentence(word: str, reason: str, target: str, source: str) -> str:
    """
    Say what became of a pair, and why, with the names of its robots.

    Parameters
    ----------
    word : what the team does: accepted, refused, updated, replaced, kept, withdrawn
    reason : of the newest verdict, which begins with its own word: accepted, refused, ambiguous
    target, source : names of the robots
    """
    reason = reason.replace('the target map', f"{target}'s map")
    reason = reason.replace('the source map', f"{source}'s map")
    now, _, why = reason.partition(': ')
    if word in ('accepted', 'refused'):
        return reason
    if word == 'kept':
        return f'kept, though this time {now}: {why}'
    return f'{word}: {why}'


def begun(robot: str, epoch: str, time: int, pause: float, back: bool) -> str:
    """Say that a robot began another map, or went back, and in how many seconds it is matched."""
    if back:
        return (f'{robot} went back to an earlier state of its map ({epoch}): what was said of it '
                f'has lapsed, what was accepted is matched anew in {pause:.0f} s')
    return (f'{robot} began another map ({epoch}), for the {ordinal(time)} time: all that was '
            f'said of its old one has lapsed, its place is sought in {pause:.0f} s')


def ordinal(number: int) -> str:
    """Write a number as first, second, third, 4th ..."""
    words = ('first', 'second', 'third')
    if 1 <= number <= len(words):
        return words[number - 1]
    ending = 'th' if number % 100 in (11, 12, 13) else {1: 'st', 2: 'nd', 3: 'rd'}.get(
        number % 10, 'th')
    return f'{number}{ending}'
