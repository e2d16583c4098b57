# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The demonstration says what came out, beside the truth, and says in a sentence why it failed."""

import json
from pathlib import Path
import subprocess
import sys
from typing import Any

from helpers import fake_grid, fake_room, ROOT, ros_environment
import numpy as np
import pytest
from somfusion_ros.geometry import inverse, Pose
from somfusion_ros.io.result import read_evidence, write_robot_map
from somfusion_ros.io.trajectories import write_tum
from somfusion_ros.ros.apps import demo, demo_team
from somfusion_ros.ros.apps.demo_picture import draw_live
from somfusion_ros.ros.apps.demo_table import compare, table
from somfusion_ros.ros.apps.processes import Processes
from somfusion_ros.team.wall_agreement import wall_agreement

TRUTH = Pose(4.0, -1.0, 0.5)
MAP = {'count': 3, 'width': 10, 'height': 20, 'frame': 'world', 'stamp': 1.0}


def status_of(transforms: dict[str, dict[str, Pose]], maps: bool = True) -> dict[str, Any]:
    """Make a recorder's status out of transforms by robot and peer."""
    def record(peers: dict[str, Pose]) -> dict[str, Any]:
        return {'maps': {'map': MAP, 'global_map': MAP} if maps else {'map': MAP},
                'first_pose': {'stamp': 0.0, 'pose': [0.0, 0.0, 0.0], 'first': 2.0},
                'transforms': {f'{peer}/map': {'pose': list(pose), 'first': 12.0}
                               for peer, pose in peers.items()}}
    said = {'robot1/fusion_node: robot2': {
        'message': 'ok', 'values': {'V': '97.5', 'probability': '0.999'}}}
    return {'robots': {robot: record(peers) for robot, peers in transforms.items()},
            'diagnostics': said}


def both(T: Pose) -> dict[str, Any]:
    """Make a status in which both robots publish T_robot1_robot2."""
    return status_of({'robot1': {'robot2': T}, 'robot2': {'robot1': Pose(*inverse(T))}})


def test_every_transform_stands_beside_the_truth_in_its_own_direction() -> None:
    rows = compare(both(Pose(4.1, -1.0, 0.5)), {('robot1', 'robot2'): TRUTH})
    assert [(row.target, row.source) for row in rows] == [('robot1', 'robot2'),
                                                          ('robot2', 'robot1')]
    for row in rows:
        np.testing.assert_allclose(row.error, (0.1, 0.0), atol=1e-9)
        assert row.after == pytest.approx(10.0)
        assert row.within((0.2, 1.0))
        assert not row.within((0.05, 1.0))
    assert rows[0].verification_index == '97.5'


def test_table_lines_up_and_names_the_reference() -> None:
    lines = table(compare(both(TRUTH), {('robot1', 'robot2'): TRUTH}), 'truth')
    assert len(lines) == 5
    assert lines[0].index('probability') < lines[1].index('0.999') + len('0.999')
    assert lines[2].split() == ['truth', '4.000', '-1.000', '28.65']
    without = table(compare(both(TRUTH), None), 'truth')
    assert len(without) == 3


def test_a_team_is_joined_only_when_every_robot_knows_all() -> None:
    robots = ['robot1', 'robot2']
    assert demo_team.joined(both(TRUTH), robots)
    one_sided = status_of({'robot1': {'robot2': TRUTH}, 'robot2': {}})
    assert not demo_team.joined(one_sided, robots)
    assert not demo_team.joined(status_of({'robot1': {'robot2': TRUTH},
                                           'robot2': {'robot1': TRUTH}}, maps=False), robots)
    assert not demo_team.joined({'robots': {}, 'diagnostics': {}}, robots)


def test_why_not_repeats_the_reason_of_the_nodes() -> None:
    status = status_of({'robot1': {}, 'robot2': {}}, maps=False)
    status['diagnostics']['robot1/fusion_node: robot2'] = {
        'message': 'robot2 has been silent for 40 s', 'values': {'reason': 'walls agree 70 %'}}
    words = demo_team.why_not(status, ['robot1', 'robot2'])
    assert 'robot1 published no global map' in words
    assert 'walls agree 70 %' in words


def test_a_team_has_settled_when_every_node_says_so() -> None:
    status = both(TRUTH)
    assert demo_team.settled(status)
    status['diagnostics']['robot2/fusion_node'] = {'message': 'ok', 'values': {'settled': 'False'}}
    assert not demo_team.settled(status)


def test_picture_shows_every_robot(tmp_path: Path) -> None:
    for robot in ('robot1', 'robot2'):
        for kind in ('map', 'global_map'):
            write_robot_map(tmp_path / 'live' / robot / kind, fake_grid(fake_room()))
        write_tum(tmp_path / 'live' / robot / 'path.tum', [1.0, 2.0], [(1, 1, 0), (2, 1, 0)])
    path = draw_live(tmp_path, ['robot1', 'robot2'], compare(both(TRUTH), None))
    assert path.read_bytes().startswith(b'\x89PNG')
    assert path.stat().st_size > 20000


@pytest.mark.parametrize('arguments, reason', [
    (['only_one'], 'at least two bags'),
    (['missing1', 'missing2'], 'missing1'),
    (['a', 'b', '--rate', '0'], 'rate'),
])
def test_bad_use_is_one_line_and_status_2(
        arguments: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo.importlib.util, 'find_spec', lambda name: object())
    assert demo.main([*arguments, '--output', str(tmp_path / 'out')]) == 2
    said = capsys.readouterr().err
    assert reason in said
    assert len(said.splitlines()) == 1


def test_without_rclpy_it_says_what_to_do(tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                          monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo.importlib.util, 'find_spec', lambda name: None)
    assert demo.main(['--output', str(tmp_path)]) == 2
    assert 'rclpy is missing' in capsys.readouterr().err


def test_a_wrong_merge_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                    capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(demo, 'draw_live', lambda *_: tmp_path / 'live.png')
    monkeypatch.setattr(demo, 'robot_lines', lambda *_: [])
    with pytest.raises(demo_team.LiveError, match='2.00 m'):
        demo.show(tmp_path, {}, both(Pose(6.0, -1.0, 0.5)), {('robot1', 'robot2'): TRUTH}, {},
                  'truth')
    assert json.loads((tmp_path / 'live.json').read_text())['pairs'][0]['error'][0] == 2.0
    assert 'truth' in capsys.readouterr().out


def test_a_node_that_dies_is_named_and_nothing_is_left(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'broken.py').write_text('raise SystemExit("out of memory")')
    (tmp_path / 'sleeper.py').write_text('import time; time.sleep(60)')
    started: list[Processes] = []

    def start(processes: Processes, *_: object) -> None:
        started.append(processes)
        processes.start('slam_robot1', 'broken')
        processes.start('player_robot1', 'sleeper')

    class FakeLog:
        duration = 10.0

    monkeypatch.setattr(demo_team, '_start', start)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    (tmp_path / 'live').mkdir()
    (tmp_path / 'live' / 'status.json').write_text(json.dumps(both(TRUTH)))
    with pytest.raises(demo_team.LiveError, match='slam_robot1 ended early.*out of memory'):
        demo_team.run_team({'robot1': FakeLog()}, tmp_path / 'live', demo_team.LiveOptions())
    assert started[0].ended().keys() == {'slam_robot1', 'player_robot1'}
    assert demo_team.read_status(tmp_path / 'live')['robots'] == {}, 'of an earlier run'


@pytest.mark.system
def test_demonstration_from_nothing(tmp_path: Path) -> None:
    """What `make demo` runs: simulate, play into four nodes, show; faster here than by default."""
    pytest.importorskip('rclpy')
    result = subprocess.run(
        [sys.executable, '-m', 'somfusion_ros.ros.apps.demo', '--output', str(tmp_path / 'out'),
         '--rate', '3'], cwd=ROOT, env=ros_environment(), capture_output=True, text=True,
        timeout=240)
    assert result.returncode == 0, result.stdout + result.stderr
    record = json.loads((tmp_path / 'out' / 'live.json').read_text())
    assert {(p['target'], p['source']) for p in record['pairs']} == {
        ('robot1', 'robot2'), ('robot2', 'robot1')}
    for pair in record['pairs']:
        assert pair['error'][0] < 0.5
        assert pair['error'][1] < 5.0
    assert (tmp_path / 'out' / 'live.png').exists()
    assert 'truth' in result.stdout
    live = tmp_path / 'out' / 'live'
    for robot in ('robot1', 'robot2'):     # the views were told, and asked
        assert 'views confirm' in (live / 'logs' / f'fusion_{robot}.log').read_text()
    one, other = (read_evidence(live / robot / 'global_map') for robot in ('robot1', 'robot2'))
    assert wall_agreement(one, other) > 0.97
