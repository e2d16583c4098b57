# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What is given to a replay and cannot be meant so is refused or said, before anything is lost."""

from pathlib import Path
import shutil

from helpers import write_fake_bag
import pytest
from somfusion_ros.io.bags.log import BagError, BagOptions, open_log
from somfusion_ros.io.errors import InputError
from somfusion_ros.offline.replay import replay, ReplayOptions
from somfusion_ros.offline.result_bag import refuse_to_replace, ResultBag


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a bag, in a folder of its own as `simulate` does."""
    folder = tmp_path_factory.mktemp('run') / 'run1'
    write_fake_bag(folder / 'bag', every=8)
    return folder


@pytest.mark.parametrize('given', ['.', 'bag', '../run1'])
def test_a_recording_is_never_replaced_by_its_result(recorded: Path, given: str) -> None:
    before = {file: file.read_bytes() for file in (recorded / 'bag').iterdir()}
    with pytest.raises(InputError, match='would replace it; give another --output'):
        replay([recorded / given], recorded, ReplayOptions(bag=True, pictures=False))
    assert {file: file.read_bytes() for file in (recorded / 'bag').iterdir()} == before


def test_only_what_a_replay_wrote_is_replaced(recorded: Path, tmp_path: Path) -> None:
    shutil.copytree(recorded / 'bag', tmp_path / 'bag')
    with pytest.raises(InputError, match='no bag of an earlier replay'):
        refuse_to_replace(tmp_path / 'bag', [recorded / 'bag'])
    with ResultBag(tmp_path / 'result') as bag:
        bag.odometry(1.0, (0.0, 0.0, 0.0))
    refuse_to_replace(tmp_path / 'result', [recorded / 'bag'])
    refuse_to_replace(tmp_path / 'new', [recorded / 'bag'])
    with pytest.raises(InputError, match='would replace it'):
        refuse_to_replace(tmp_path / 'result', [tmp_path / 'result' / 'result.mcap'])


def test_one_bag_is_not_two_robots(recorded: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match='a bag is given twice'):
        replay([recorded, recorded / 'bag'], tmp_path / 'out')


@pytest.mark.parametrize('source', ['encoders', 'tf', 'none'])
def test_a_topic_of_odometry_and_another_source_contradict(recorded: Path, source: str) -> None:
    with pytest.raises(BagError, match=f'not used with odometry source {source}'):
        open_log(recorded, BagOptions(odom_topic='/odom', odometry_source=source,
                                      wheel_radius=0.1, wheel_separation=0.3))


def test_wheels_that_are_not_used_are_said(recorded: Path) -> None:
    log = open_log(recorded, BagOptions(wheel_radius=0.1, wheel_separation=0.3))
    assert log.odometry_source == 'odom'
    assert any('give --odometry-source encoders' in note for note in log.notes)
    assert not open_log(recorded).notes
