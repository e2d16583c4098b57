# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Study robots that are taken up while they drive, and put down where they have been before.

usage: python -m benchmarks.slam.carried [RUNS [FIRST]] [--resumed]
       (default: 60 1000; about 2 minutes of a core)

In an office, with four lasers in turn, on three routes. After 24 to 39 of 60 s the robot is, from
one scan to the next, at another place of its way, and drives on from there; its wheels tell
nothing of it. With --resumed the robot is in its map of another drive of 60 s: it was carried
while it was switched off, too, and its wheels go on as if nothing had happened.

Prints by laser how many robots did not notice until the end, for how long their
pose was off by more than half a metre and not called lost, how long they were lost, and how many
were so before anything happened (with --resumed, all since it was switched on counts). Asserts
nothing.
"""

from dataclasses import dataclass, replace
import sys

from benchmarks.tables import Table
import numpy as np
from somfusion_ros.geometry import Array, between, Pose
from somfusion_ros.simulation import drive
from somfusion_ros.simulation.floor_plan import FloorPlan, PLANS
from somfusion_ros.simulation.laser import Laser, Scene
from somfusion_ros.simulation.trial import run_trial, simulate_trial, Trial
from somfusion_ros.slam.slam import Slam

MOUNT = Pose(0.2, 0.0, 0.0)
LASERS = {'180 deg, 12 m, 2.5 Hz': Laser(181, np.pi, 0.1, 12.0, 0.4, mount=MOUNT),
          '360 deg, 12 m, 5 Hz': Laser(360, 2.0 * np.pi, 0.1, 12.0, 0.2, mount=MOUNT),
          '240 deg, 5.6 m, 5 Hz': Laser(341, np.radians(240.0), 0.06, 5.6, 0.2, mount=MOUNT),
          '270 deg, 30 m, 10 Hz': Laser(541, np.radians(270.0), 0.1, 30.0, 0.1, mount=MOUNT)}
SPEED, DURATION = 0.7, 60.0    # [m/s] [s]
OFF = 0.5                      # [m] by which a pose is wrong
MOVED = 0.7                    # [m] that a robot was carried, to count
NEWEST = 15                    # scans that show whether it has noticed at the end


@dataclass(frozen=True)
class Fate:
    """How one robot fared: whether it noticed, and for how long [s] it was wrong and lost."""

    unnoticed: bool
    wrong: float
    lost: float
    lost_before: bool


def follow(route: Array) -> tuple[Array, Array]:
    """Return stamps (T,) [s] and poses (T, 3) along a route (K, 2) [m]."""
    heading = float(np.arctan2(*(route[1] - route[0])[::-1]))
    return drive.follow(route, heading, SPEED, DURATION)


def resume(trial: Trial, start: Array, plan: FloorPlan, laser: Laser, rng: np.random.Generator
           ) -> tuple[Trial, Slam]:
    """Map on another drive; return a trial from a pose (3,) as it goes on, and its SLAM."""
    scene, (stamps, poses) = Scene(plan.segments), follow(plan.route(int(rng.integers(3))))
    before = simulate_trial(lambda t: scene, stamps, poses, laser, rng)
    slam = Slam(checkpoint=run_trial(before).slam.checkpoint())
    both = before.then(trial, between(poses[0], start), laser)
    return replace(both, scans=both.scans[len(before.scans):]), slam


def carried(number: int, laser: Laser, resumed: bool = False) -> Fate:
    """Drive, be taken up, and drive on."""
    rng, plan = np.random.default_rng(number), PLANS['office']()
    scene, (stamps, poses) = Scene(plan.segments), follow(plan.route(int(rng.integers(3))))
    taken = int(len(stamps) * rng.uniform(0.4, 0.65))
    put = int(taken * rng.uniform(0.0, 0.9))
    left = len(stamps) - taken
    first = simulate_trial(lambda t: scene, stamps[:taken], poses[:taken], laser, rng)
    second = simulate_trial(lambda t: scene, stamps[:left], poses[put:put + left], laser, rng)
    trial = first.then(second, between(poses[0], poses[put]), laser)
    trial, slam = resume(trial, poses[0], plan, laser, rng) if resumed else (trial, None)
    outcome = run_trial(trial, slam=slam)
    since = -np.inf if resumed else first.scans[-1].stamp
    after = np.array([step.stamp for step in outcome.steps]) > since
    lost = np.array([step.reason == 'lost' for step in outcome.steps])
    off = np.hypot(*outcome.error[:, :2].T) > OFF
    moved = np.hypot(*between(poses[taken - 1], poses[put])[:2]) > MOVED
    return Fate(bool(moved and off[-NEWEST:].any() and not lost[-NEWEST:].any()),
                laser.period * np.count_nonzero(off & ~lost & after),
                laser.period * np.count_nonzero(lost & after), bool(lost[~after].any()))


def carried_table(runs: int, first: int, resumed: bool = False) -> Table:
    """Return how robots with each laser fared."""
    kinds, fates = list(LASERS), dict[str, list[Fate]]()
    for number in range(first, first + runs):
        kind = kinds[number % len(kinds)]
        fates.setdefault(kind, []).append(carried(number, LASERS[kind], resumed))
    table = Table('carried', (
        'laser', 'drives', 'unnoticed at the end', 'wrong unnoticed, mean [s]', '90 % [s]',
        'lost, mean [s]', 'lost before'), (None, None, None, 1, 1, 1))
    everybody = [fate for kind in fates.values() for fate in kind]
    return table.extend(
        (kind, len(all_), sum(fate.unnoticed for fate in all_),
         float(np.mean([fate.wrong for fate in all_])),
         float(np.percentile([fate.wrong for fate in all_], 90)),
         float(np.mean([fate.lost for fate in all_])), sum(fate.lost_before for fate in all_))
        for kind, all_ in {**fates, 'all': everybody}.items())


def main() -> None:
    """Print the table."""
    words = [int(word) for word in sys.argv[1:] if word != '--resumed']
    runs, first = words + [60, 1000][len(words):]
    print(carried_table(runs, first, '--resumed' in sys.argv).markdown())


if __name__ == '__main__':
    main()
