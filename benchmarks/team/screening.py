# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Measure whether clusters alone tell which maps are worth sending.

usage: python -m benchmarks.team.screening [FOLDER]       (default: the shared pairs)

For every pair of maps, both robots screen the other's clusters, as they come over the wire, and
the whole maps are matched. Prints how many pairs that the verdict accepts would have been missed,
and how many others would have been sent for nothing. Asserts nothing.
"""

import csv
from pathlib import Path
import sys
import time

from benchmarks.data.folders import data_folder
from benchmarks.data.real_maps import load_pair
from builtin_interfaces.msg import Time
import numpy as np
from somfusion_ros.fusion.alignment import align
from somfusion_ros.fusion.learning import learn
from somfusion_ros.io.cluster_rows import cluster_rows
from somfusion_ros.ros.common.conversions import cluster_cloud
from somfusion_ros.ros.fusion.team_messages import clusters_from_message
from somfusion_ros.team.screening import outline, screen


def main() -> None:
    """Print the table."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else data_folder() / 'pairs'
    counts, missed, sizes, seconds = np.zeros((2, 2), int), [], [], []
    with (folder / 'manifest.csv').open() as file:
        names = [row['name'] for row in csv.DictReader(file)]
    for name in names:
        pair = load_pair(folder, name)
        clouds = [cluster_cloud(cluster_rows(outline(learn(grid))), 'map', Time())
                  for grid in pair]
        sizes += [len(cloud.data) for cloud in clouds]
        start = time.process_time()
        likely = [screen(learn(grid), clusters_from_message(cloud)).likely
                  for grid, cloud in zip(pair, clouds[::-1], strict=True)]
        seconds.append((time.process_time() - start) / 2.0)
        accepted = align(*pair).accepted
        counts[int(accepted), int(any(likely))] += 1
        if accepted and not any(likely):
            missed.append(name)
    print(f'of {counts[1].sum()} pairs that are accepted, {counts[1, 0]} would be missed '
          f'{" ".join(missed)}\nof {counts[0].sum()} others, {counts[0, 1]} would be sent for '
          f'nothing\n{np.median(sizes) / 1e3:.1f} kB of clusters per map (median), '
          f'{max(sizes) / 1e3:.1f} kB (most); {1e3 * np.median(seconds):.0f} ms to screen one')


if __name__ == '__main__':
    main()
