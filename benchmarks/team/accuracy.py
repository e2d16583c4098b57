# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure whether a team's robots are placed right: every team of the data folder, replayed.

usage: python -m benchmarks.team.accuracy [OUT]      (default: output/figures/teams)

The replays stay in OUT, one folder per team.
"""

from collections.abc import Sequence
from pathlib import Path
import sys

from benchmarks.data.folders import data_folder, RecordedTeam, ROOT, teams
from benchmarks.scores.teams import score_team
from benchmarks.tables import Table
import numpy as np
from somfusion_ros.offline.replay import replay, ReplayOptions


def team_table(recorded: Sequence[RecordedTeam], out: Path) -> Table:
    """Replay teams; return verdict and errors of every pair of robots."""
    table = Table('team', ('team', 'pair', 'verdict', 'probability', 'error [m]', '[deg]',
                           'walls within 0.10 m: rigid', 'bent into one', 'right'),
                  (None, None, None, 2, 2, 1, 3, 3))
    for team in recorded:
        replay([log / 'bag' for log in team.logs], out / team.name, ReplayOptions(pictures=False))
        for score in score_team(out / team.name, team.logs):
            right = not score.connected if team.strangers else score.connected
            table.add(team.name, f'{score.target}, {score.source}',
                      'connected' if score.connected else 'refused', score.probability,
                      score.error if not team.strangers else None,
                      float(np.degrees(score.turn)) if not team.strangers else None, score.rigid,
                      score.walls, 'yes' if right else 'no')
    return table


def main() -> None:
    """Print the table."""
    data = data_folder()
    if data is None:
        raise SystemExit(f'{__doc__}\nno data folder was found')
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / 'output' / 'figures' / 'teams'
    print(team_table(teams(data), out).markdown())


if __name__ == '__main__':
    main()
