# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What robots that are gone said last, as others tell it, and which of several words counts."""

from dataclasses import dataclass, replace

from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.pair_words import agreeing
from somfusion_ros.team.seal import Seal

Words = tuple[MapConstraint, ...]


@dataclass(frozen=True, eq=False)
class DepartedRobot:
    """
    A robot that is gone, which map it had, how many cells are known, what it had accepted.

    seal: its own, under what it had accepted.
    """

    robot: str
    known: int
    constraints: tuple[MapConstraint, ...] = ()
    epoch: Epoch = Epoch()
    seal: Seal | None = None


Said = list[tuple[str, DepartedRobot]]    # who says what of one robot


def renewed(said: Said) -> Said:
    """Put the newest words that a robot sealed in place of older ones under the same key."""
    newest: dict[bytes, tuple[Seal, DepartedRobot]] = {}
    for _, gone in said:     # the own word is the first
        if gone.seal and (gone.seal.key not in newest or gone.seal > newest[gone.seal.key][0]):
            newest[gone.seal.key] = gone.seal, gone
    return [(owner, _instead(gone, newest[gone.seal.key][1]) if gone.seal else gone)
            for owner, gone in said]


def same_word(one: DepartedRobot, other: DepartedRobot) -> bool:
    """Return whether two words are of the same seal and map, and so the same."""
    return (one.seal, one.epoch) == (other.seal, other.epoch)


def alike(ones: Words, others: Words) -> bool:
    """Return whether the matches that both hold agree."""
    before, after = ({frozenset(one.robots): one for one in words if one.kind == 'match'}
                     for words in (ones, others))
    both = sorted(before.keys() & after.keys(), key=sorted)
    return not both or bool(agreeing([before[pair] for pair in both],
                                     [after[pair] for pair in both]).all())


def agreed(said: Said, own: str) -> tuple[str, DepartedRobot]:
    """Choose the word that counts among those of several robots on one that is gone."""
    names = [gone.epoch for _, gone in said]
    mine = {gone.epoch for owner, gone in said if owner == own}
    epoch = max(sorted(set(names), key=str), key=lambda one: (names.count(one), one in mine))
    return min(((owner, gone) for owner, gone in said if gone.epoch == epoch),
               key=lambda word: (-word[1].known, word[0]))


def _instead(gone: DepartedRobot, newest: DepartedRobot) -> DepartedRobot:
    """Return what a robot sealed last, with how much is known of its map by who says less."""
    if newest.seal == gone.seal:
        return gone
    return replace(newest, known=gone.known if newest.epoch == gone.epoch else 0)
