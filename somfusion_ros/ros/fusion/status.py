# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What fusion_node tells /diagnostics: how the node is doing, and how each peer."""

from collections.abc import Collection, Mapping
from math import inf
from statistics import median
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from somfusion_ros.ros.common.diagnostics import status
from somfusion_ros.team.channels import BONDS, CLUSTERS, MAP_CHANNELS, VIEWS
from somfusion_ros.team.heard import Heard
from somfusion_ros.team.snapshot import Snapshot
from somfusion_ros.team.world import anchor_of


def fusion_statuses(node: str, robot: str, snapshot: Snapshot, heard: Mapping[str, Heard],
                    faults: Mapping[str, int], now: float, timeout: float,
                    missing: Collection[str] = (), without_clock: str = '',
                    present: Collection[str] = ()) -> list[DiagnosticStatus]:
    """
    Return one status of the node, one per peer, and one per listed peer that was never seen.

    without_clock: why there is no time, '' where there is; present: robots that publish now.
    """
    connected = snapshot.connected(robot)
    values = {'peers': len(heard) - 1, 'connected': ', '.join(connected) or 'nobody',
              'world_is_map_of': anchor_of(snapshot.world(robot), snapshot.anchor),
              'world_changes': snapshot.world_changes,
              'dropped': '; '.join(d.reason for d in snapshot.solution.dropped),
              'transform_jumps': snapshot.jumps, **faults}
    silent = without_clock if heard[robot].maps else "the robot's own map has not come yet"
    return [status(node, robot, values, silent), *(
        _peer_status(node, peer, snapshot, heard[peer], peer in connected, now,
                     inf if latched(heard[peer]) and peer in present else timeout)
        for peer in sorted(heard) if peer != robot), *(
        status(f'{node}: {peer}', peer, {'connected': False}, never_seen(peer))
        for peer in sorted(missing))]


def latched(heard: Heard) -> bool:
    """Tell whether a peer's map needs no repeating: one of map_server is told once."""
    return bool(heard.maps) and not heard.session


def never_seen(peer: str) -> str:
    """Return what to look for where a listed peer does not show up."""
    return (f'{peer} is listed in peers, but was never seen: is it running, in the namespace '
            f'/{peer}, in this ROS domain and within reach?')


def _peer_status(node: str, peer: str, snapshot: Snapshot, heard: Heard, connected: bool,
                 now: float, timeout: float) -> DiagnosticStatus:
    """Describe one peer: what was heard, the verdict, and what is missing."""
    values: dict[str, Any] = {
        'heard_s': now - heard.at, 'late_s': heard.late, 'map_age_s': now - heard.map_at,
        'maps': heard.maps,
        'bytes_received': sum(heard.received.values()),
        'bytes_of_maps': sum(heard.received[topic] for topic in MAP_CHANNELS),
        'bytes_of_views': heard.received[VIEWS], 'bytes_of_bonds': heard.received[BONDS],
        'view_age_s': median(heard.view_ages) if heard.view_ages else float('nan'),
        'connected': connected, 'settled': peer in snapshot.settled}
    verdict, warning = snapshot.verdicts.get(peer), ''
    if verdict is not None:
        rival = verdict.runner_up.probability if verdict.runner_up else 0.0
        values |= {'overlap': verdict.overlap, 'V': verdict.verification_index,
                   'J': verdict.performance_index[-1] if verdict.performance_index else 0.0,
                   'probability': verdict.probability, 'runner_up': rival,
                   'verdict': snapshot.words.get(peer, ''), 'reason': verdict.reason,
                   'ms_per_attempt': 1e3 * sum(verdict.seconds.values())}
    if values['heard_s'] == float('inf'):
        warning = f'nothing was heard of {peer} yet'
    elif values['heard_s'] > timeout:
        warning = f'{peer} has been silent for {values["heard_s"]:.0f} s'
    elif not heard.maps and heard.received[CLUSTERS]:
        warning = f'no match with {peer} is likely yet, so its whole map was not asked for'
    elif not heard.maps:
        warning = f'{peer} has not sent a map'
    elif not connected:
        warning = verdict.reason if verdict is not None else f'{peer} is not matched yet'
    warning = '; '.join(filter(None, (snapshot.suspected.get(peer), warning)))
    return status(f'{node}: {peer}', peer, values, warning)
