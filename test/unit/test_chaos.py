# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Teams in simulated time under random faults: fixed seeds, and a new one every day."""

from datetime import date
from functools import cache
import os
from pathlib import Path
import pickle
import subprocess
import sys

import numpy as np
import pytest
from somfusion_ros.fusion.cache import FusionCache
from somfusion_ros.fusion.config import FusionConfig
from somfusion_ros.geometry import Pose
from somfusion_ros.simulation.chaos import memory
from somfusion_ros.simulation.chaos.campaign import run_seed, shrink, Team
from somfusion_ros.simulation.chaos.disk import KINDS as DAMAGE
from somfusion_ros.simulation.chaos.disk import restarted
from somfusion_ros.simulation.chaos.faults import Fault
from somfusion_ros.simulation.chaos.invariants import error_of
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.simulation.chaos.memory import Memory
from somfusion_ros.simulation.chaos.network import Conditions, Network
from somfusion_ros.simulation.chaos.records import Outcome
from somfusion_ros.simulation.chaos.station import world_of
from somfusion_ros.simulation.chaos.tapes import record_all, Tape
from somfusion_ros.team.shared_map import SharedMap

pytestmark = pytest.mark.slow

AGAIN = """
import pickle, sys
from pathlib import Path
from somfusion_ros.simulation.chaos.campaign import run_seed
from somfusion_ros.simulation.chaos.matching import Matching
from somfusion_ros.team.fact_reader import FactReader
folder, matching = Path(sys.argv[1]), Matching()
matching.memory.load(folder / 'memory')
matching.reader = FactReader()
tapes = pickle.loads((folder / 'tapes').read_bytes())
print(run_seed(5, tapes, matching).digest.hex(), matching.memory.done)
"""

FIXED = (0, 3, 10)      # the last one found that a liar's word made others drop a map
MORE = (1, 2, 4, 6, 7)
FRESH = 1_000_000 + date.today().toordinal()


@cache
def tapes() -> list[Tape]:
    """Record what real SLAM sessions make of six drives, once."""
    return record_all(30.0)


@cache
def matching() -> Matching:
    """Remember what was matched."""
    return Matching()


def said(outcome: Outcome) -> str:
    """Say what broke, and how to see it again."""
    return (f'python -m benchmarks.team.chaos --seed {outcome.seed}: {outcome.broken}; '
            f'{[str(fault) for fault in outcome.faults]}')


@pytest.mark.parametrize('seed', FIXED)
def test_a_team_survives_what_a_seed_chooses(seed: int) -> None:
    outcome = run_seed(seed, tapes(), matching())
    assert not outcome.broken, said(outcome)
    assert outcome.accepted > 0


@pytest.mark.system
@pytest.mark.parametrize('seed', [*MORE, FRESH])
def test_a_team_survives_more_seeds(seed: int) -> None:
    outcome = run_seed(seed, tapes(), matching())
    assert not outcome.broken, said(outcome)


def test_the_same_seed_is_the_same_run_bit_for_bit(tmp_path: Path) -> None:
    """In another process, too, where hashes are others, and where every fact is unpacked anew."""
    first = run_seed(5, tapes(), matching())
    assert first.digest != b''
    assert run_seed(6, tapes(), matching()).digest != first.digest
    matching().memory.save(tmp_path / 'memory')
    (tmp_path / 'tapes').write_bytes(pickle.dumps(tapes()))
    found = subprocess.run(
        [sys.executable, '-c', AGAIN, str(tmp_path)], capture_output=True, text=True, check=True,
        env={**os.environ, 'PYTHONHASHSEED': '7', 'PYTHONPATH': os.pathsep.join(sys.path)})
    assert found.stdout.split() == [first.digest.hex(), '0']


def test_what_is_matched_does_not_depend_on_what_a_session_learned_before() -> None:
    """To the last bit: what is kept of earlier maps rounds otherwise."""
    one, other = tapes()[0], tapes()[1]
    grown = FusionCache()
    for k in range(2):
        grids = [SharedMap.from_cells(tape.maps[k]).grid for tape in (one, other)]
        found, fresh = (Matching().align(*grids, FusionConfig(), cache)
                        for cache in (grown, FusionCache()))
        assert found.T_target_source == fresh.T_target_source
        assert np.array_equal(found.covariance, fresh.covariance)


def test_a_memory_of_other_code_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                            ) -> None:
    kept, other, same = Memory(2), Memory(2), Memory(2)
    for key in 'abc':
        kept.of(key, key.upper)
    assert kept.known == {'b': 'B', 'c': 'C'}      # the oldest went
    kept.save(tmp_path / 'memory')
    same.load(tmp_path / 'memory')
    monkeypatch.setattr(memory, 'code_digest', lambda: 'another')
    other.load(tmp_path / 'memory')
    assert same.known == kept.known
    assert not other.known


def test_a_memory_saves_each_result_once(tmp_path: Path) -> None:
    """What another process saved is not saved again, nor read twice."""
    one, other = Memory(9), Memory(9)
    one.of('a', 'a'.upper)
    one.save(tmp_path / '1')
    other.of('b', 'b'.upper)
    other.load(tmp_path / '1')
    other.save(tmp_path / '2')
    assert pickle.loads((tmp_path / '2').read_bytes())[1] == {'b': 'B'}
    (tmp_path / '1').unlink()
    other.load(tmp_path / '1')      # it is known, and not looked for
    one.load(tmp_path / '2')
    assert one.known == other.known == {'a': 'A', 'b': 'B'}


def test_what_breaks_is_found_and_shrunk_to_the_faults_that_matter(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """A session that raises when it meets a ghost: two of three faults have no part in it."""
    faults = [Fault(10.0, 'loss', 'robot1', 10.0, 0.1),
              Fault(12.0, 'reset', 'robot1', 1.0, 0.1),
              Fault(14.0, 'clock step', 'robot1', 1.0, 0.1)]
    honest = Team._strike

    def strike(team: Team, fault: Fault, now: float) -> None:
        honest(team, fault, now)
        if fault.kind == 'reset':
            station = team.robots['robot1'].station
            assert station is not None
            monkeypatch.setattr(station, 'work', lambda now: 1 / 0)
    monkeypatch.setattr(Team, '_strike', strike)
    broken = run_seed(1, tapes(), matching(), faults)
    assert any('ZeroDivisionError' in text for text in broken.broken)
    assert [fault.kind for fault in shrink(broken, tapes(), matching()).faults] == ['reset']


def test_a_wrong_transform_would_be_found() -> None:
    first, second = tapes()[:2]
    truth = error_of(Pose(), first, first)
    assert truth == 0.0
    assert error_of(Pose(1.0, 0.0, 0.0), first, first) == pytest.approx(1.0)
    assert error_of(Pose(), first, tapes()[-2]) == np.inf
    assert second.place == first.place


def test_a_robot_that_is_restarted_in_another_building_loses_its_place() -> None:
    """Within a match period, though the match is refused: what was said of its map has lapsed."""
    faults = [Fault(40.0, 'slam restart elsewhere', 'robot2', 1.0, 0.0)]
    team = Team(2, faults, tapes(), matching())
    outcome = team.run()
    assert not outcome.broken, said(outcome)
    for robot in team.robots.values():
        assert robot.station is not None
        assert ('robot2' in world_of(robot.station)) == (robot.name == 'robot2')
        assert any('robot2 began another map' in word for word in robot.station.words)


def test_two_ends_that_look_alike_are_told_apart_by_who_drives_there() -> None:
    """No map can for 50 s: 98 % of the walls agree, and all views find what they look for."""
    ends = [tape for tape in tapes() if tape.place == 'corridor']
    assert error_of(Pose(), *ends) > 20.0
    cache = FusionCache()
    for k in (0, 2, 4):
        grids = [SharedMap.from_cells(end.maps[k]).grid for end in ends]
        verdict = matching().align(*grids, FusionConfig(), cache)
        assert verdict.accepted == (ends[0].map_times[k] < ends[0].alike_until)
    team = Team(1, [], [*ends, tapes()[0]], matching())
    outcome = team.run()
    assert not outcome.broken, said(outcome)
    assert outcome.stood == 0.0     # not for a moment: it would have both drive in one place
    assert outcome.alike
    assert max(probability for probability, _ in outcome.alike) < 0.1
    for robot in team.robots.values():
        assert robot.station is not None
        assert robot.station.session.snapshot.verdicts
        assert not any(c.kind == 'match' for c in robot.station.session.snapshot.constraints)


def test_a_node_that_begins_anew_is_told_that_two_ends_are_two() -> None:
    """It has not heard where the robots were: the pair stood for 24 s, until maps told it."""
    ends = [tape for tape in tapes() if tape.place == 'corridor']
    team = Team(1, [Fault(19.4, 'robot off', 'robot1', 45.0, 0.5)], [*ends, tapes()[0]],
                matching())
    outcome = team.run()
    assert not outcome.broken, said(outcome)
    assert outcome.stood == 0.0


def test_a_robot_that_was_carried_off_is_lost_and_found() -> None:
    carried = tapes()[-1]
    assert carried.lost_for > 2.0
    assert carried.place == tapes()[0].place


@pytest.mark.parametrize('damage', DAMAGE)
def test_a_disk_that_fails_costs_no_more_than_it_must_and_is_reported(damage: str) -> None:
    tape = tapes()[0]
    whole = len(tape.kept[-1].poses)
    for variant in range(2):
        again, counts = restarted(tape, len(tape.kept), damage, variant)
        reported = sum(counts[name] for name in ('state_damaged', 'state_unusable',
                                                 'state_not_saved'))
        views = 0 if again is None else len(again.kept[0].poses)
        assert views == whole or reported
        assert (views == whole and not reported) or damage


def test_a_network_brings_the_newest_through_loss_and_a_cut() -> None:
    network = Network(np.random.default_rng(0))
    network.subscribe('b', 'a', 'state', 0.0)
    network.conditions = Conditions(loss=0.6, cut=frozenset('b'))
    for number in range(5):
        network.publish('a', 'state', number, 10, float(number))
    assert not list(network.deliver(20.0))
    network.conditions = Conditions(loss=0.6)
    came = [one.message.payload for at in range(20, 60) for one in network.deliver(float(at))]
    assert came[-1] == 4
    network.leave('a')
    network.subscribe('c', 'a', 'state', 61.0)
    assert not list(network.deliver(90.0))


def test_a_log_comes_whole_and_in_order_however_bad_the_network_is() -> None:
    network = Network(np.random.default_rng(0))
    network.conditions = Conditions(loss=0.5, spread=2.0, rate=50.0)
    network.subscribe('b', 'a', 'log', 0.0)
    for number in range(20):
        network.publish('a', 'log', number, 100, float(number), log=True)
    came = [one.message.payload for at in range(20) for one in network.deliver(float(at))]
    assert len(came) < 20       # 2000 bytes at 50 bytes a second
    network.recover(20.0)
    network.subscribe('c', 'a', 'log', 20.0)
    later = [one for at in range(20, 40) for one in network.deliver(float(at))]
    assert came + [one.message.payload for one in later if one.listener == 'b'] == [*range(20)]
    assert [one.message.payload for one in later if one.listener == 'c'] == [*range(20)]
