# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""`somfusion merge`: saved maps in, one stitched map out."""

import argparse

from somfusion_ros.cli.options import add_fusion, add_output, Commands, given


def add(commands: Commands) -> None:
    """Describe `merge`."""
    command = commands.add_parser(
        'merge', help='saved maps -> one stitched map',
        description='Find how saved maps lie to one another and stitch them.')
    command.add_argument('maps', nargs='+', metavar='MAP.yaml',
                         help='map_server YAML files, at least two')
    command.add_argument('--rigid', action='store_true',
                         help='lay the maps together as they are, do not bend them')
    add_output(command)
    add_fusion(command)
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Run `merge`."""
    from somfusion_ros.fusion.config import FusionConfig
    from somfusion_ros.io.parameters import make, read_parameters
    from somfusion_ros.offline.merge import merge
    values = read_parameters(options.parameters)
    config = make(FusionConfig, values, **given(method=options.method))
    merge(options.maps, options.output, config, not options.no_report, options.rigid)
