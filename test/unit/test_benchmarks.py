# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The ways into the benchmarks: converters, scorers, tables; the measuring itself is no test."""

import ast
from pathlib import Path

from benchmarks import figures, tables
from benchmarks.data import carmen, map_pairs, mines
from benchmarks.fusion.judging import CODE
from benchmarks.fusion.stages import load_all
from benchmarks.scores.pairs import score_pair, summary
from benchmarks.scores.teams import walls_agree
from helpers import fake_grid, fake_room, ROOT
import numpy as np
import pytest
from somfusion_ros.geometry import between, compose, Pose
from somfusion_ros.io.bags.log import open_log
from somfusion_ros.io.maps import write_map
from somfusion_ros.io.trajectories import read_tum

FLASER = ('FLASER 4 1.0 2.0 3.0 81.9 {x} 0.0 0.0 {odom} 0.0 0.0 {stamp} host {stamp}\n'
          'ODOM {odom} 0.0 0.0 0.5 0.0 0.0 {stamp} host {stamp}\n')
ROBOTLASER = ('ROBOTLASER1 0 -1.57 3.14 0.785 80.0 0.01 0 5 1.0 2.0 3.0 2.0 1.0 0 '
              '{x} 0.0 0.0 {odom} 0.0 0.0 0.5 0.0 0.3 0.3 1e6 {stamp} host {stamp}\n')


@pytest.mark.parametrize('line, beams', [(FLASER, 4), (ROBOTLASER, 5)])
def test_a_carmen_log_becomes_a_bag(tmp_path: Path, line: str, beams: int) -> None:
    """The laser sits 0.2 m ahead; its mount, scans and odometry come back from the bag."""
    log = tmp_path / 'some.log'
    log.write_text('# CARMEN Logfile\n' + ''.join(
        line.format(x=0.2 + k, odom=float(k), stamp=100.0 + k) for k in range(3)))
    assert carmen.write_log(log, tmp_path / 'out') == 3
    bag = open_log(tmp_path / 'out' / 'bag')
    assert bag.T_base_laser == pytest.approx((0.2, 0.0, 0.0), abs=1e-6)
    scan = next(carmen.read_carmen(log))
    assert len(scan.ranges) == beams
    assert scan.angle_min == pytest.approx(-np.pi / 2.0, abs=1e-3)
    assert scan.angle_increment == pytest.approx(np.pi / 4.0, abs=1e-3)
    assert bag.duration == pytest.approx(2.0, abs=1e-6)


def test_a_corrected_log_is_the_reference_of_the_robot(tmp_path: Path) -> None:
    """Poses in the log are the laser's, those in reference.tum the robot's."""
    log = tmp_path / 'some.log'
    log.write_text(FLASER.format(x=0.2, odom=0.0, stamp=100.0))
    corrected = tmp_path / 'corrected.log'
    corrected.write_text(FLASER.format(x=5.2, odom=0.0, stamp=100.0))
    carmen.write_reference(corrected, next(carmen.read_carmen(log)), tmp_path)
    stamps, poses = read_tum(tmp_path / 'reference.tum')
    assert stamps.tolist() == [100.0]
    assert poses[0] == pytest.approx((5.0, 0.0, 0.0), abs=1e-6)


def test_a_broken_line_is_named(tmp_path: Path) -> None:
    log = tmp_path / 'some.log'
    log.write_text(FLASER.format(x=0.2, odom=0.0, stamp=100.0) + 'FLASER 4 1.0 2.0\n')
    with pytest.raises(ValueError, match='line 3'):
        list(carmen.read_carmen(log))


def test_a_log_of_the_mines_rover_becomes_a_bag(tmp_path: Path) -> None:
    """Two thousand ticks are half a turn of a wheel of 0.077 m."""
    log = tmp_path / 'exp.dat'
    log.write_text(''.join(
        ' '.join(map(str, [k * 1000000, 0, 1000 * k, 1000 * k, *[0] * 20, *[1500] * 682])) + '\n'
        for k in range(3)))
    assert mines.write_log(log, tmp_path / 'out') == 3
    stamps, encoders, ranges = mines.read_mines(log)
    assert stamps.tolist() == [0.0, 1.0, 2.0]
    assert encoders[1] == pytest.approx((np.pi / 2.0, np.pi / 2.0))
    assert ranges.shape == (3, 542)
    assert (ranges == 1.5).all()
    assert open_log(tmp_path / 'out' / 'bag').T_base_laser == mines.T_BASE_LASER


def test_saved_maps_become_pairs(tmp_path: Path) -> None:
    """A list of saved maps with their true pose is what the scorers read, whatever the frames."""
    T = Pose(3.0, -1.0, 0.7)
    room = fake_grid(fake_room())
    write_map(tmp_path / 'a', room)
    write_map(tmp_path / 'b', fake_grid(fake_room(), T_map_walls=T))
    truth = between(T, Pose())
    (tmp_path / 'list.csv').write_text(
        'place_target,target,place_source,source,x,y,theta\n'
        f'room,a/map.yaml,room,b/map.yaml,{truth[0]},{truth[1]},{truth[2]}\n'
        'room,a/map.yaml,other,b/map.yaml,,,\n')
    assert map_pairs.convert(tmp_path / 'list.csv', tmp_path / 'pairs') == 2
    true, different = load_all(tmp_path / 'pairs')
    assert true.truth == pytest.approx(truth, abs=1e-5)
    assert different.truth is None
    assert walls_agree(true.target, true.source, true.truth) > 0.95


def test_a_pose_is_scored_where_the_maps_overlap() -> None:
    """A turn about the overlap's centre moves nothing there, however far the origin is."""
    truth, centre = np.array([1.0, 2.0, 0.5]), np.array([100.0, 0.0])
    turned = compose(truth, compose((*centre, 0.01), (*-centre, 0.0)))
    score = score_pair(truth, centre, turned, accepted=True)
    assert score.error == pytest.approx(0.0, abs=1e-9)
    assert score.right and score.strict
    off = score_pair(truth, centre, truth + (0.3, 0.0, 0.0), accepted=True)
    assert off.right and not off.strict
    false = score_pair(None, None, truth, accepted=True)
    found = summary([score, off, false, score_pair(truth, centre, None, accepted=False)])
    assert found['success'] == pytest.approx(2 / 3)
    assert (found['wrong'], found['false']) == (0, 1)


def test_a_table_goes_between_its_markers_and_nowhere_else(tmp_path: Path) -> None:
    document = tmp_path / 'some.md'
    document.write_text('before\n<!-- figures: a -->\nold\n<!-- end of figures: a -->\nafter\n')
    table = tables.Table('a', ('name', 'value'), (None, 2))
    table.add('x', 1.0)
    table.add('y', None)
    for _ in range(2):      # a second time changes nothing more
        tables.write_into(document, table, 'from here')
    lines = document.read_text().splitlines()
    assert lines[0] == 'before'
    assert lines[-1] == 'after'
    assert '| x    | 1.00  |' in lines
    assert '_from here_' in lines
    assert 'old' not in lines
    with pytest.raises(KeyError):
        tables.write_into(document, tables.Table('b', ('name',)), 'from here')


def test_every_table_has_a_place_and_every_place_a_table() -> None:
    made = {word for path in (ROOT / 'benchmarks').rglob('*.py')
            for word in tables.names_in(path.read_text(encoding='utf-8'))}
    assert set(tables.places()) <= made
    assert set(figures.PARTS.known) >= {'slam', 'pairs', 'team', 'stages', 'calibration'}


USAGES = {path: text for path in sorted((ROOT / 'benchmarks').rglob('*.py'))
          if 'usage:' in (text := ast.get_docstring(ast.parse(path.read_text())) or '')}


@pytest.mark.newest
@pytest.mark.parametrize('path', USAGES, ids=lambda path: path.stem)
def test_a_benchmark_names_the_command_that_runs_it(path: Path) -> None:
    """By its module: as a file it finds neither the others nor the package."""
    module = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
    assert f'python -m {module}' in USAGES[path]


@pytest.mark.newest
def test_what_was_judged_is_kept_for_the_same_code_only() -> None:
    """A pattern that matched no file let cases stand that older code had judged."""
    files = {path.name for pattern in CODE for path in ROOT.glob(pattern)}
    assert all(any(ROOT.glob(pattern)) for pattern in CODE)
    assert {'grid.py', 'geometry.py', 'search.py', 'true_cases.py'} <= files
