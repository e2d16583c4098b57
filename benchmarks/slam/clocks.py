# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study what faults of the clocks cost: drives through an office whose messages have wrong stamps.

usage: python -m benchmarks.slam.clocks [WORD...]    (only the faults that have these words;
       all take about 7 minutes of a core)

At 0.7 m/s, with ten scans and twenty odometry samples a second. Prints by fault how many of the
scans were not used, over what distance at most none was, how far the pose was off at most, and
at the end, whether a new map was begun, and what was counted. Asserts nothing.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
import sys

from benchmarks.tables import Table
import numpy as np
from somfusion_ros.geometry import between, Pose
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import simulate_trial, Trial
from somfusion_ros.slam.config import SlamConfig
from somfusion_ros.slam.session import Session

LASER = Laser(181, np.pi, 0.1, 12.0, 0.1, turn=0.05, mount=Pose(0.2, 0.0, 0.0))
SPEED, DURATION, ZERO = 0.7, 45.0, 1e5    # [m/s] [s] [s] the stamp when the drive begins
TIMEOUT = 0.5                             # [s] that a scan waits for its odometry
SCAN_DELAY, ODOMETRY_DELAY = 0.03, 0.005  # [s] from the end of a measurement to its arrival
STRAIGHT, TURNING, TAKEN = 25.0, 0.0, 18.0   # [s] moments of the drive
STEPS = (-3600.0, -5.0, -1.2, -0.3, 0.3, 1.2, 5.0, 3600.0)   # [s]

Clock = Callable[[float], float]    # true time [s] since the begin to a stamp [s]


@dataclass(frozen=True)
class Fault:
    """
    What is wrong with the stamps of a drive.

    The clocks of the scans and of the odometry; when a scan of a time [s] arrives, without the
    delay; how often messages are told; when [s] the SLAM starts again from its checkpoint; and
    whether the robot is taken up at TAKEN.
    """

    name: str
    scans: Clock = lambda t: t
    odometry: Clock = lambda t: t
    arrives: Clock = lambda t: t
    odometry_arrives: Clock = lambda t: t
    times: int = 1
    restart: float = np.inf
    carried: bool = False


def steps(*jumps: tuple[float, float]) -> Clock:
    """Return a clock that is set at times [s] by so many seconds."""
    return lambda t: t + sum(jump for at, jump in jumps if t >= at)


def stands(at: float, for_: float, goes_on: bool) -> Clock:
    """Return a clock that stands still, and then goes on from there, or is right again."""
    return lambda t: (t if t < at or t >= at + for_ and not goes_on else
                      at if t < at + for_ else t - for_)


def rate(share: float, since: float = 0.0) -> Clock:
    """Return a clock that runs at another rate."""
    return lambda t: t + (share - 1.0) * max(0.0, t - since)


def held(at: float, for_: float) -> Clock:
    """Return when messages arrive that are held for a while."""
    return lambda t: at + for_ if at <= t < at + for_ else t


def late(by: float, in_: float) -> Clock:
    """Return when messages arrive that come late for ten seconds, at once or ever more."""
    def arrives(t: float) -> float:
        if t < STRAIGHT:
            return t
        if t >= STRAIGHT + 10.0:
            return max(t, STRAIGHT + 10.0 + by)
        return t + by * (min(1.0, (t - STRAIGHT) / in_) if in_ else 1.0)
    return arrives


def always_late(by: float) -> Clock:
    """Return when messages arrive that come late from the first on."""
    return lambda t: t + by


def lost(at: float, for_: float) -> Clock:
    """Return when messages arrive of which some never do."""
    return lambda t: np.inf if at <= t < at + for_ else t


def faults(turning: float) -> Iterator[Fault]:
    """Yield all faults; turning [s]: a moment in a turn."""
    same: Clock = lambda t: t
    yield Fault('none')
    for at, where in ((STRAIGHT, ''), (turning, ' in a turn'), (0.35, ' at the start')):
        for jump in STEPS:
            set_ = steps((at, jump))
            yield Fault(f'scans {jump:+g}{where}', set_)
            yield Fault(f'odometry {jump:+g}{where}', same, set_)
            yield Fault(f'both {jump:+g}{where}', set_, set_)
    for jump in (-3600.0, -5.0, 5.0, 3600.0):
        for after in (2.0, 8.0):
            for back, word in ((-jump, 'back'), (jump, 'again')):
                set_ = steps((STRAIGHT, jump), (STRAIGHT + after, back))
                yield Fault(f'scans {jump:+g} and {word} after {after:g}', set_)
                yield Fault(f'odometry {jump:+g} and {word} after {after:g}', same, set_)
                yield Fault(f'both {jump:+g} and {word} after {after:g}', set_, set_)
    for jump in (-5.0, 5.0):
        yield Fault(f'both {jump:+g}, odometry 2 s later', steps((STRAIGHT, jump)),
                    steps((STRAIGHT + 2.0, jump)))
        yield Fault(f'both {jump:+g}, scans 2 s later', steps((STRAIGHT + 2.0, jump)),
                    steps((STRAIGHT, jump)))
        for after in (-0.05, 0.35, 3.0):
            set_, where = steps((STRAIGHT + after, jump)), f'{after:+g} after a restart'
            yield Fault(f'scans {jump:+g}, {where}', set_, restart=STRAIGHT)
            yield Fault(f'odometry {jump:+g}, {where}', same, set_, restart=STRAIGHT)
            yield Fault(f'both {jump:+g}, {where}', set_, set_, restart=STRAIGHT)
        set_ = steps((STRAIGHT - 1.0, jump))
        yield Fault(f'scans {jump:+g}, 1 before a restart', set_, restart=STRAIGHT)
        yield Fault(f'odometry {jump:+g}, 1 before a restart', same, set_, restart=STRAIGHT)
        for after in (2.0, 5.0):
            set_ = steps((TAKEN + after, jump))
            yield Fault(f'scans {jump:+g}, {after:g} after taken up', set_, carried=True)
            yield Fault(f'odometry {jump:+g}, {after:g} after taken up', same, set_, carried=True)
            yield Fault(f'both {jump:+g}, {after:g} after taken up', set_, set_, carried=True)
    yield Fault('none, taken up', carried=True)
    yield Fault('none, restart', restart=STRAIGHT)
    for for_ in (0.5, 1.5, 4.0, 10.0):
        for goes_on, word in ((False, 'then right'), (True, 'then goes on')):
            still = stands(STRAIGHT, for_, goes_on)
            yield Fault(f'scans stand still {for_:g}, {word}', still)
            yield Fault(f'odometry stands still {for_:g}, {word}', same, still)
            yield Fault(f'both stand still {for_:g}, {word}', still, still)
    for for_ in (0.4, 1.5, 4.0):
        arrives = held(STRAIGHT, for_)
        yield Fault(f'scans held {for_:g}', arrives=arrives)
        yield Fault(f'odometry held {for_:g}', odometry_arrives=arrives)
        yield Fault(f'both held {for_:g}', arrives=arrives, odometry_arrives=arrives)
        yield Fault(f'scans held {for_:g}, stamped on arrival', arrives, arrives=arrives)
        yield Fault(f'odometry held {for_:g}, stamped on arrival', same, arrives,
                    odometry_arrives=arrives)
        yield Fault(f'both held {for_:g}, stamped on arrival', arrives, arrives, arrives, arrives)
        yield Fault(f'scans lost for {for_:g}', arrives=lost(STRAIGHT, for_))
        yield Fault(f'odometry lost for {for_:g}', odometry_arrives=lost(STRAIGHT, for_))
    for by in (0.8, 1.5, 2.5, 4.0):
        for in_ in (0.0, 2.0, 5.0):
            yield Fault(f'scans late by {by:g} in {in_:g}', arrives=late(by, in_))
            yield Fault(f'odometry late by {by:g} in {in_:g}', odometry_arrives=late(by, in_))
    for share in (0.5, 0.9, 0.99, 0.999, 1.001, 1.01, 1.1, 2.0):
        for since, word in ((0.0, ''), (STRAIGHT, ' from the middle on')):
            yield Fault(f'scans at {share:g} of the speed{word}', rate(share, since))
            yield Fault(f'odometry at {share:g} of the speed{word}', same, rate(share, since))
            yield Fault(f'both at {share:g} of the speed{word}', rate(share, since),
                        rate(share, since))
    for by in (1.5, 2.5, 4.0, 5.5, 7.0):
        yield Fault(f'odometry late by {by:g} all the time', odometry_arrives=always_late(by))
    yield Fault('everything told twice', times=2)
    for off in (-20.0, -2.0, -0.5, -0.1, 0.1, 0.5, 2.0, 20.0):
        yield Fault(f'scans {off:+g} all the time', steps((0.0, off)))


def simulated(route: int, carried: bool) -> Trial:
    """Drive through the office; perhaps be taken up, and put down where it was before."""
    rng, plan = np.random.default_rng(route), PLANS['office']()
    scene, way = Scene(plan.segments), plan.route(route)
    heading = float(np.arctan2(*(way[1] - way[0])[::-1]))
    stamps, poses = drive.follow(way, heading, SPEED, DURATION)
    taken = int(np.searchsorted(stamps, TAKEN)) if carried else len(stamps)
    first = simulate_trial(lambda t: scene, stamps[:taken], poses[:taken], LASER, rng)
    if not carried:
        return first
    put, left = taken // 2, len(stamps) - taken
    second = simulate_trial(lambda t: scene, stamps[:left], poses[put:put + left], LASER, rng)
    return first.then(second, between(poses[0], poses[put]), LASER)


@dataclass(frozen=True)
class Fate:
    """What a fault cost: see the module."""

    unused: int
    gap: float
    worst: float
    end: float
    counts: Counter[str]


def suffer(trial: Trial, fault: Fault) -> Fate:
    """Feed a drive with wrong stamps to a session, as its messages arrive."""
    counts: Counter[str] = Counter()

    def count(kind: str, reason: str = '') -> None:
        counts[kind] += 1

    events = [(fault.odometry_arrives(t) + ODOMETRY_DELAY, t, -1, k)
              for k, t in enumerate(trial.odometry_stamps.tolist())] + [
        (fault.arrives(scan.stamp) + scan.sweep + SCAN_DELAY, scan.stamp, k, -1)
        for k, scan in enumerate(trial.scans)]
    session, found, restarted = Session(SlamConfig(), TIMEOUT, count, background=False), [], False
    for now, t, scan, odometry in sorted(event for event in events if event[0] < np.inf):
        if t >= fault.restart and not restarted:
            restarted = True
            session = Session(SlamConfig(), TIMEOUT, count, background=False,
                              checkpoint=session.slam.checkpoint())
        for _ in range(fault.times):
            if scan < 0:
                session.add_odometry(ZERO + fault.odometry(t), trial.odometry[odometry],
                                     trial.slip[odometry])
            else:
                told = trial.scans[scan]
                session.add_scan(replace(told, stamp=ZERO + fault.scans(t)), scan, now)
            found += list(session.steps(now))
    found += list(session.finish())
    used = [(tag, step) for tag, step in found if step.accepted and step.reason != 'lost']
    if not used:
        return Fate(len(trial.scans), np.inf, np.inf, np.inf, counts)
    stamps = np.array([trial.scans[tag].stamp for tag, _ in used])
    true = trial.truth(stamps)
    true = between(true[0], true)     # the map begins with the first scan that is used
    told = np.array([step.pose for _, step in used]).reshape(-1, 3)
    off = np.hypot(*(told - true)[:, :2].T)
    way = np.hypot(*np.diff(true[:, :2], axis=0).T)
    return Fate(len(trial.scans) - len({tag for tag, _ in used}), float(way.max()),
                float(off.max()), float(off[-1]), counts)


def main() -> None:
    """Print the table."""
    trials = {carried: simulated(0, carried) for carried in (False, True)}
    poses = trials[False].poses
    turn = np.abs(np.gradient(np.unwrap(poses[:, 2]), drive.STEP))
    moving = (trials[False].stamps > 15.0) & (trials[False].stamps < 40.0)
    turning = float(trials[False].stamps[np.argmax(turn * moving)])
    table = Table('clocks', ('fault', 'scans not used', 'longest gap [m]', 'worst [m]',
                             'end [m]', 'counted'), (None, None, 2, 3, 3, None))
    for fault in faults(turning):
        if all(word in fault.name for word in sys.argv[1:]):
            fate = suffer(trials[fault.carried], fault)
            table.add(fault.name, fate.unused, fate.gap, fate.worst, fate.end,
                      ', '.join(f'{kind} {n}' for kind, n in sorted(fate.counts.items())))
            print(' | '.join(table.rows[-1]), flush=True)
    print(table.markdown())


if __name__ == '__main__':
    main()
