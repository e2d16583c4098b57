# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What `somfusion watch` shows: maps as characters, teams as they merge, states and reasons."""

from collections.abc import Iterator
import os
from pathlib import Path
import pty
import re
import subprocess
import sys
import time

from helpers import fake_grid, fake_room, need_ros, ros_environment
from matplotlib.colors import to_rgb
import numpy as np
from pace import patient
import pytest
from rich.console import Console
from somfusion_ros.geometry import compose, inverse, Pose
from somfusion_ros.report.map_text import LOWER, map_text, MARK, Mark, SHARED, UPPER
from somfusion_ros.report.palette import BOTH, FREE, team_colours
from somfusion_ros.report.watch_view import Health, HeardTeam, view

WALLS = fake_room()
FRAMES = {'robot1': Pose(), 'robot2': Pose(3.0, -2.0, 0.6)}


def team() -> HeardTeam:
    """Make a team of two that see the same room."""
    return HeardTeam({robot: fake_grid(WALLS, T_map_walls=pose) for robot, pose in FRAMES.items()})


def shown(what: HeardTeam, width: int = 100, height: int = 40) -> str:
    """Print a team without colours."""
    console = Console(width=width, height=height, force_terminal=False)
    with console.capture() as captured:
        console.print(view(what, width, height))
    return captured.get()


def test_a_picture_becomes_characters_of_its_colours() -> None:
    image = np.ones((4, 3, 3))
    image[0, 0] = (0.0, 0.0, 1.0)    # the lowest row comes first
    image[3, 2] = image[2, 2] = (1.0, 0.0, 0.0)
    text = map_text((image, (0.0, 3.0, 0.0, 4.0)), 3, 2, [Mark(1.5, 0.5, '#00ff00')])
    lines = text.plain.split('\n')
    assert [line.ljust(3) for line in lines] == [f'  {UPPER}', f'{LOWER}{MARK} ']
    styles = {str(span.style) for span in text.spans}
    assert styles == {'#ff0000 on #ff0000', '#0000ff', 'bold #00ff00'}


@pytest.mark.parametrize(('width', 'height'), [(20, 10), (80, 12), (200, 60)])
def test_a_map_fits_the_terminal(width: int, height: int) -> None:
    lines = map_text((np.zeros((300, 400, 3)), (0.0, 4.0, 0.0, 3.0)), width, height)
    lines = lines.plain.split('\n')
    assert len(lines) <= height
    assert max(map(len, lines)) <= width
    assert len(lines) > height - 2 or max(map(len, lines)) > width - 2   # and it fills it


def test_thin_walls_do_not_vanish() -> None:
    image = np.ones((400, 400, 3))
    image[:, 201] = 0.0
    lines = map_text((image, (0.0, 1.0, 0.0, 1.0)), 40, 20).plain.split('\n')
    assert all(UPPER in line for line in lines)


def test_walls_of_several_robots_are_grey_and_no_colours_are_mixed() -> None:
    colours = list(team_colours(['robot1', 'robot2']).values())
    image = np.ones((400, 400, 3))
    image[100:300, 100:300] = to_rgb(FREE)
    image[:, 101], image[:, 104], image[:, 301] = *map(to_rgb, colours), to_rgb(BOTH)
    image[200] = to_rgb(colours[0])
    text = map_text((image, (0.0, 1.0, 0.0, 1.0)), 40, 20)
    styles = {word for span in text.spans for word in str(span.style).split() if word != 'on'}
    assert styles == {SHARED, FREE.lower(), colours[0].lower()}


def test_a_team_is_shown_before_and_after_it_merged() -> None:
    both = team()
    assert [list(group) for group in both.groups()] == [['robot1'], ['robot2']]
    assert shown(both).count('not merged') == 2
    T_1_2 = Pose.from_array(compose(FRAMES['robot1'], inverse(FRAMES['robot2'])))
    both.transforms = {'robot2': {'robot1': Pose.from_array(inverse(T_1_2))},
                       'robot1': {'robot2': T_1_2, 'unheard': Pose()}}
    (group,) = both.groups()
    assert list(group) == ['robot1', 'robot2']
    assert np.allclose(group['robot2'], T_1_2)
    assert 'robot1 + robot2: one map' in shown(both)


def test_a_map_server_that_sorts_first_is_in_the_group_that_took_it() -> None:
    grids = team().grids
    both = HeardTeam({'floor': grids['robot1'], 'robot2': grids['robot2']})
    both.transforms = {'robot2': {'floor': Pose(1.0, 2.0, 0.5)}}
    (group,) = both.groups()
    assert np.allclose(compose(group['robot2'], (1.0, 2.0, 0.5)), group['floor'])


def test_robots_reasons_and_figures_are_named() -> None:
    both = team()
    both.poses['robot1'] = Pose(2.0, 2.0, 0.0)
    both.health['robot1/fusion_node: robot2'] = Health(1, 'walls agree 40 %', {'V': '61'})
    words = shown(both)
    assert MARK in words
    assert re.search(r'robot1/fusion_node: robot2 +walls agree 40 % +V 61', words)
    both.health['robot1/fusion_node: robot2'] = Health(1, 'a long reason ' * 20, {'V': '61'})
    assert 'robot1/fusion_node: robot2' in shown(both)
    assert team_colours(sorted(FRAMES))['robot1'] != team_colours(sorted(FRAMES))['robot2']


def test_reasons_are_told_whole_where_the_maps_still_have_room() -> None:
    some, reason = team(), 'no scan yet: nobody publishes /robot1/scan; scans are on /robot_1/scan'
    some.health['robot1/slam_node'] = Health(1, reason, {'scans_per_s': '0'})
    wrapped = ''.join(line[18:].split('scans_per_s')[0].rstrip() for line in
                      shown(some, 70).splitlines()[-6:])
    assert '/robot_1/scan' in wrapped
    assert len(shown(some, 70, 30).splitlines()) <= 30
    some.health |= {f'robot{n}/slam_node': Health(1, reason, {}) for n in range(2, 12)}
    assert '…' in shown(some, 70, 30)


def test_nobody_is_there_yet() -> None:
    assert 'no robot has published a map yet' in shown(HeardTeam())


@pytest.fixture
def published(ros_domain: int) -> Iterator[None]:
    """Publish two maps in a ROS graph of the test's own."""
    need_ros()
    from builtin_interfaces.msg import Time
    from nav_msgs.msg import OccupancyGrid
    import rclpy
    from somfusion_ros.ros.common import conversions, qos
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('publisher', context=context)
    for robot, grid in team().grids.items():
        node.create_publisher(OccupancyGrid, f'/{robot}/map', qos.LATCHED).publish(
            conversions.grid_message(grid, 'map', Time()))
    yield
    node.destroy_node()
    context.try_shutdown()


def command(*options: str) -> list[str]:
    """Return the command line of watch."""
    return [sys.executable, '-m', 'somfusion_ros.cli.main', 'watch', *options]


@pytest.mark.system
def test_the_command_shows_a_team_once_in_a_pipe(published: None, ros_domain: int,
                                                 tmp_path: Path) -> None:
    picture = tmp_path / 'watch.svg'
    ended = subprocess.run(command('--once', '--wait', '6', '--svg', str(picture)),
                           env=ros_environment(ros_domain), capture_output=True, text=True,
                           timeout=60)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.count('not merged') == 2
    assert 'robot2' in picture.read_text()


@pytest.mark.parametrize('options', [['--wait', 'nan'], ['--wait', '-1'],
                                     ['--svg', 'no/such/folder.svg']])
def test_bad_usage_is_said_before_anything_is_heard(
        options: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    need_ros()
    from somfusion_ros.ros.apps.watch import main
    with pytest.raises(SystemExit) as stopped:
        main(options)
    assert stopped.value.code == 2
    assert options[0] in capsys.readouterr().err.splitlines()[-1]


def read(terminal: int) -> str:
    """Read what was drawn; '' once the program has left the terminal."""
    try:
        return os.read(terminal, 65536).decode(errors='replace')
    except OSError:
        return ''


@pytest.mark.system
def test_the_command_draws_in_a_terminal_until_it_is_told_to_stop(published: None,
                                                                  ros_domain: int) -> None:
    here, there = pty.openpty()
    environment = ros_environment(ros_domain) | {'TERM': 'xterm-256color', 'COLUMNS': '100',
                                                 'LINES': '40'}
    process = subprocess.Popen(command(), env=environment, stdin=there, stdout=there,
                               stderr=there)
    os.close(there)
    seen, begin = '', time.monotonic()
    while 'robot2' not in seen and patient(40.0, begin):
        seen += read(here)
    process.terminate()
    while process.poll() is None and patient(40.0, begin):
        seen += read(here)
    os.close(here)
    assert 'robot2' in seen
    assert UPPER in seen
    assert process.returncode == 0
    assert 'Traceback' not in seen
