# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Which map it is: written and read, kept across a restart, new with every new map."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from somfusion_ros.grid import Grid
from somfusion_ros.simulation.floor_plan import office
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import SICK
from somfusion_ros.slam.checkpoint_file import load_checkpoint, save_checkpoint
from somfusion_ros.slam.checkpoint_keeper import CheckpointKeeper
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.epoch import Epoch
from somfusion_ros.slam.grid_views import grid_checkpoint
from somfusion_ros.slam.session import Session
from somfusion_ros.slam.start import Start

STARTS = st.text('0123456789abcdefghijklmnopqrstuvwxyz', min_size=1, max_size=32)


def session(start: str, **options: object) -> Session:
    """Make a session that counts what is wrong."""
    faults: Counter[str] = Counter()
    return Session(SlamConfig(), 0.5, lambda kind, reason='': faults.update([kind]),
                   background=False, start=start, **options)


def drive(session: Session, laser: Laser = SICK) -> None:
    """Let a robot stand in an office for a second."""
    rng, scene = np.random.default_rng(0), Scene(office().segments)
    poses = np.tile((3.0, 5.2, 0.0), (laser.beams, 1))
    for stamp in np.arange(100.0, 101.0, 0.1):
        session.add_odometry(stamp, np.zeros(3))
        session.add_scan(laser.scan(stamp, scene, poses, rng), None, 0.0)
        list(session.steps(0.0))


@given(STARTS, st.integers(0, 10 ** 9 - 1))
def test_an_epoch_is_read_as_it_was_written(start: str, reset: int) -> None:
    assert Epoch.parse(str(Epoch(start, reset))) == Epoch(start, reset)


@given(STARTS.map(lambda start: start[:19]), st.integers(0, 10 ** 9 - 1), STARTS)
def test_so_is_that_of_a_map_that_went_back(start: str, reset: int, program: str) -> None:
    back = Epoch(start, reset).gone_back(program)
    assert Epoch.parse(str(back)) == back != Epoch(start, reset)
    assert back.same_map(Epoch(start, reset))
    assert not back.same_map(Epoch(start, reset + 1))
    assert not back.same_map(Epoch(f'{start}x', reset))


@given(st.one_of(st.text(), st.none(), st.integers(), st.binary(), st.lists(st.text())))
def test_anything_else_is_no_epoch(text: object) -> None:
    try:
        assert str(Epoch.parse(text)) == text or int(str(text).rpartition('.')[2]) >= 0
    except ValueError as error:
        assert len(str(error)) < 100


@pytest.mark.parametrize('text', ['', '.0', 'a.', 'a', 'A.1', 'a.-1', 'a.1 ', 'a.1\n', 'a b.1',
                                  '\ud800.1', f'{"a" * 33}.0', 'a.1234567890',
                                  'a.0.', 'a.0.B', f'a.0.{"b" * 13}', f'{"a" * 32}.0.{"b" * 12}'])
def test_no_epochs(text: str) -> None:
    with pytest.raises(ValueError, match='epoch'):
        Epoch.parse(text)


def test_every_new_map_has_an_epoch_of_its_own() -> None:
    one = session('1f')
    seen = [one.slam.epoch]
    for _ in range(3):
        one.reset()
        seen.append(one.slam.epoch)
    assert seen == [Epoch('1f', number) for number in range(4)]
    assert session('2e').slam.epoch not in seen


def test_a_robot_that_goes_on_with_its_map_goes_on_with_its_epoch(tmp_path: Path) -> None:
    first = session('1f')
    drive(first)
    save_checkpoint(tmp_path / 'state.npz', first.slam.checkpoint())
    again = session('2e', checkpoint=load_checkpoint(tmp_path / 'state.npz'))
    assert again.slam.epoch.same_map(Epoch('1f', 0))
    again.reset()
    assert again.slam.epoch == Epoch('2e', 1)


def test_a_map_went_back_unless_its_program_ended_in_order(tmp_path: Path) -> None:
    """What was told after the last checkpoint is of another state, which nobody has any more."""
    counted: Counter[str] = Counter()

    def keeper() -> CheckpointKeeper:
        return CheckpointKeeper(str(tmp_path / 'state'), 0.0, lambda kind, reason='':
                                counted.update([kind]), lambda text: None)

    def gone_on(name: str, how: Start = Start()) -> tuple[Session, CheckpointKeeper]:
        kept = keeper()
        checkpoint = kept.load()
        assert checkpoint is not None
        return session(name, checkpoint=checkpoint, how=how), kept
    first, kept = session('1f'), keeper()
    drive(first)
    kept.keep(first.slam, object(), 0.0)
    kept.close()                                            # it is killed
    second, kept = gone_on('2e')
    assert second.slam.epoch == Epoch('1f', 0, '2e')
    kept.keep(second.slam, step := object(), 0.0)
    kept.shut(step)                                         # it ends in order
    kept.close()
    third, kept = gone_on('3d')
    assert third.slam.epoch == Epoch('1f', 0, '2e')         # which has told as much as is kept
    kept.close()                                            # it is killed, and kept nothing
    fourth, kept = gone_on('4c')
    assert fourth.slam.epoch == Epoch('1f', 0, '4c')
    kept.shut(None)                                         # it ends before its first scan, and
    kept.close()                                            # the third has told more than is kept
    again, kept = gone_on('5b')
    assert again.slam.epoch == Epoch('1f', 0, '5b')
    kept.close()
    fixed, kept = gone_on('6a', Start(localization=True))
    assert fixed.slam.epoch == Epoch('1f', 0, '2e')         # a fixed map does not change
    kept.forget()
    kept.shut(None)
    assert not (tmp_path / 'state').exists()
    kept.close()
    assert not counted


def test_a_map_that_was_made_offline_begins_its_epoch_where_it_is_loaded(tmp_path: Path) -> None:
    first = session('')
    drive(first)
    save_checkpoint(tmp_path / 'state.npz', first.slam.checkpoint())
    again = session('2e', checkpoint=load_checkpoint(tmp_path / 'state.npz'))
    assert again.slam.epoch == Epoch('2e', 0)


@pytest.mark.parametrize('begun', range(3))
def test_a_map_that_is_begun_anew_without_a_name_can_be_read(begun: int, tmp_path: Path) -> None:
    """A replay that learned the order of the beams wrote a state that could not be read."""
    one = session('')
    for _ in range(begun):
        one.reset()
    state = grid_checkpoint(Grid(np.pad(np.ones((80, 80)), 3, constant_values=-1.0), 0.05))
    save_checkpoint(tmp_path / 'state.map', replace(state, epoch=one.slam.epoch))
    assert load_checkpoint(tmp_path / 'state.map').epoch == one.slam.epoch == Epoch('', begun)
