# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A team of real processes, each robot in a network of its own, on links as bad as radio links get.

One team of four lives through all tests, with the Fast DDS profile for wireless networks. During
every fault the robots map on. Afterwards, within 30 s, all show the same global map: 99.9 % of
its known cells are equal, and it knows 98 % of what each robot published last, at its true place.
Slow or lossy links that carry something at all are not waited for to end: there the maps must
become equal while the fault lasts.
"""

from collections.abc import Iterator
import os

from helpers import need_ros, ROOT, ros_environment
import pytest

need_ros()

from network import need_namespaces, Network, on_network, partition  # noqa: E402, I100
from team_lab import Lab, map_of, START  # noqa: E402

need_namespaces()
pytestmark = pytest.mark.system
TEAM = ['robot1', 'robot2', 'robot3', 'robot4']
# Longer than the 20 s after which Fast DDS takes a silent robot for gone; 60 s where asked for.
OUTAGE = float(os.environ.get('SOMFUSION_OUTAGE', '24'))
PROFILE = ROOT / 'config' / 'fastdds_wifi.xml'


@pytest.fixture(scope='module')
def network() -> Iterator[Network]:
    """Return a network of four hosts."""
    with Network(len(TEAM)) as made:
        yield made


@pytest.fixture(scope='module')
def team(network: Network, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Return a team that has found together on a perfect network."""
    environment = on_network(ros_environment(7), PROFILE)
    with Lab(tmp_path_factory.mktemp('team'), environment) as made:
        for number, (robot, host) in enumerate(zip(TEAM, network.hosts), start=1):
            made.add(robot, map_of(number, len(TEAM), 0.6), host)
        made.until_equal(TEAM, timeout=2 * START)
        yield made
        made.assert_clean()


@pytest.fixture
def lab(team: Lab, network: Network) -> Iterator[Lab]:
    """Return the team, and a perfect network back after each test."""
    yield team
    network.heal()


def explore(lab: Lab, progress: float) -> None:
    """Let every robot publish a map that shows more."""
    for number, robot in enumerate(TEAM, start=1):
        lab.publish(robot, map_of(number, len(TEAM), progress))


def test_one_link_down_and_up_again(lab: Lab, network: Network) -> None:
    network.change(groups=partition(len(TEAM), [0, 1, 2]))
    explore(lab, 0.65)
    lab.pause(OUTAGE)
    # What was accepted stays.
    assert lab.connected('robot4') == set(TEAM), f'{lab.diagnostics()}\n{lab.words()}'
    network.heal()
    lab.until_equal(TEAM)


def test_two_halves_go_on_and_heal(lab: Lab, network: Network) -> None:
    network.change(groups=[[0, 1], [2, 3]])
    explore(lab, 0.7)
    lab.pause(OUTAGE)
    for half in (TEAM[:2], TEAM[2:]):
        lab.until(lambda half=half: lab.equal_within(half), lambda half=half: f'{half} agree')
    network.heal()
    lab.until_equal(TEAM)


@pytest.mark.parametrize(('loss', 'progress'), [(0.1, 0.75), (0.3, 0.8)])
def test_frames_are_lost(lab: Lab, network: Network, loss: float, progress: float) -> None:
    network.change(loss=loss)
    explore(lab, progress)
    lab.until_equal(TEAM)


def test_one_megabit_per_second(lab: Lab, network: Network) -> None:
    network.change(rate=1e6)
    explore(lab, 0.85)
    lab.until_equal(TEAM)


def test_frames_are_doubled_and_disordered(lab: Lab, network: Network) -> None:
    network.change(duplicate=0.3, reorder=0.5)
    explore(lab, 0.9)
    lab.until_equal(TEAM)


def test_a_late_joiner_on_a_lossy_link(lab: Lab, network: Network) -> None:
    network.change(loss=0.1)
    assert lab.end('robot4') == 0
    lab.start('robot4')
    explore(lab, 1.0)
    lab.until_equal(TEAM)
