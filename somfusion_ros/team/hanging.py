# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Robots that only the word of a third joins to the own one, which a liar could have made up.

Of most pairs both robots say the same, a moment apart. Where one goes on saying it alone, what it
joins may not belong together, and the user should know by whose word it does.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from heapq import heappop, heappush

from somfusion_ros.settings import tuned
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.solution import Solution


@dataclass(frozen=True)
class HangingTuning:
    """When it is said that robots hang on one word."""

    patience: float = tuned(
        30.0, 's', 'for which one robot of a pair says alone that it is one before that is told; '
        'the other one matches it within some seconds', 'by design')


TUNING = HangingTuning()


class Hanging:
    """
    Notes which robots hang on whose word, and since when, by a steady clock [s].

    doubtful: those that do so for a while, each with a sentence.
    """

    def __init__(self, name: str, clock: Callable[[], float]) -> None:
        self._name, self._clock = name, clock
        self._since: dict[tuple[str, tuple[str, ...]], float] = {}
        self.doubtful: dict[str, str] = {}

    def update(self, solution: Solution, mute: Collection[str]) -> list[tuple[str, str]]:
        """
        Note what is so now; return on whose words robots hang, with sentences, where it is new.

        mute: robots that are gone, or have no fusion node, and cannot say anything.
        """
        now, before = self._clock(), self.doubtful
        found = hanging(solution, self._name, mute)
        self._since = {key: self._since.get(key, now) for key in found.items()}
        self.doubtful = {
            robot: f'{robot} is joined to {self._name} only by what {" and ".join(authors)} '
                   'says alone: the other robot of that pair does not'
            for (robot, authors), since in self._since.items()
            if now - since > TUNING.patience}
        return [(found[robot][0], text) for robot, text in sorted(self.doubtful.items())
                if before.get(robot) != text]


def hanging(solution: Solution, name: str, mute: Collection[str] = ()
            ) -> dict[str, tuple[str, ...]]:
    """
    Return the robots that single words join to one, and the authors of those words.

    A word joins fast where both robots say it, the user does, the robot itself does, or where the
    other robot is mute.
    """
    piece = {robot: members for members in solution.pieces for robot in members}
    words: dict[str, list[tuple[str, str]]] = {}
    for word in solution.single:
        for one, other in (word.robots, word.robots[::-1]):
            words.setdefault(one, []).append((other, _doubtful(word, name, mute)))
    reached: dict[str, tuple[str, ...]] = {}
    todo: list[tuple[int, tuple[str, ...], str]] = [(0, (), name)]
    while todo:      # fewest authors first
        _, authors, robot = heappop(todo)
        if robot in reached:
            continue
        members = piece.get(robot, frozenset({robot}))
        reached |= dict.fromkeys(members, authors)
        for other, author in (way for one in members for way in words.get(one, ())):
            if other not in reached:
                more = _with(authors, author)
                heappush(todo, (len(more), more, other))
    return {robot: authors for robot, authors in reached.items() if authors}


def _doubtful(word: MapConstraint, name: str, mute: Collection[str]) -> str:
    """Return the author of a word that the other robot of the pair could say, and does not."""
    first, second = word.robots
    other = second if word.author == first else first
    return '' if word.author == name or other in mute else word.author


def _with(authors: tuple[str, ...], author: str) -> tuple[str, ...]:
    """Return authors and one more, if there is one."""
    return tuple(sorted({*authors, *([author] if author else ())}))
