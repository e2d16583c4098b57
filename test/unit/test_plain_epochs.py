# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which map it is that a SLAM publishes which tells nothing: a rule, and each listener's own."""

from helpers import fake_grid, fake_room, furnished_room
import numpy as np
from somfusion_ros.geometry import Pose
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.team.constraint import MapConstraint
from somfusion_ros.team.members import Team
from somfusion_ros.team.plain_epochs import PlainEpochs, TUNING
from somfusion_ros.team.shared_map import SharedMap

LARGE, SMALL = fake_grid(furnished_room()), fake_grid(fake_room(3.0, 2.0))
NEVER = 0, 0


def heard(plain: PlainEpochs, *grids: object) -> Epoch | None:
    """Hear the maps of robot b one after another, once patience is over."""
    plain.epoch('b', NEVER, grids[0], 0.0)
    found = None
    for k, grid in enumerate(grids):
        found = plain.epoch('b', NEVER, grid, TUNING.patience + k)
    return found


def test_a_first_map_waits_for_a_word_on_what_it_is() -> None:
    plain = PlainEpochs()
    assert plain.epoch('b', NEVER, LARGE, 0.0) is None
    assert plain.epoch('b', NEVER, LARGE, 0.9 * TUNING.patience) is None
    plain.tell('b', Epoch('7a', 2), (5, 0))
    assert plain.epoch('b', NEVER, LARGE, 9.0) is None      # it is not of that map yet
    assert plain.epoch('b', (5, 0), LARGE, 9.0) == Epoch('7a', 2)


def test_a_map_that_lost_most_of_itself_is_another_one() -> None:
    assert heard(PlainEpochs(), LARGE) == Epoch('plain', 0)
    assert heard(PlainEpochs(), LARGE, LARGE) == Epoch('plain', 0)
    assert heard(PlainEpochs(), SMALL, LARGE) == Epoch('plain', 0)     # it grew
    assert heard(PlainEpochs(), LARGE, SMALL) == Epoch('plain', 1)
    assert heard(PlainEpochs(), LARGE, SMALL, LARGE, SMALL) == Epoch('plain', 2)


def test_a_map_of_another_publisher_is_another_one() -> None:
    plain = PlainEpochs()
    plain.publisher('b', '1f')
    assert heard(plain, LARGE) == Epoch('1f', 0)
    plain.publisher('b', '2e')
    assert plain.changed(TUNING.patience + 0.1) == [('b', Epoch('2e'), True)]
    assert plain.changed(TUNING.patience + 0.2) == []
    plain.forget('b')
    assert plain.epoch('b', NEVER, LARGE, 50.0) is None


def test_words_on_a_plain_robot_count_only_for_those_who_saw_the_same_resets() -> None:
    """Robot c came after the reset that a saw: what a says is of a map that c does not know."""
    saw, came_later = heard(PlainEpochs(), LARGE, SMALL), heard(PlainEpochs(), SMALL)
    assert saw != came_later
    word = MapConstraint('a', 'b', Pose(1.0, 0.0, 0.0), 0.01 * np.eye(3), epochs=(Epoch(), saw))
    for epoch, joined in ((saw, True), (came_later, False)):
        team = Team('c')
        for robot, known in (('a', Epoch()), ('b', epoch), ('c', Epoch())):
            team.begin(robot, known)
            team.update_map(robot, SharedMap(SMALL))
        team.hear('a', [word])
        assert ('b' in team.solution().group_of('a')) == joined
