# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Other robots are no walls: not in a scan, and not in the map of the team."""

from helpers import fake_grid, fake_room, fake_scan
import numpy as np
from somfusion_ros.geometry import apply, Array, compose, inverse, Pose
from somfusion_ros.slam.bodies import Bodies
from somfusion_ros.slam.motion import Odometry
from somfusion_ros.slam.scan import cloud, Scan
from somfusion_ros.slam.slam import Slam
from somfusion_ros.team.global_map import merge_grids
from somfusion_ros.team.shared_map import mark_driven, SharedMap

ROOM = fake_room()
RADIUS = 0.25     # [m] of a robot's body
HERE = Pose(1.5, 1.5, 0.4)
T_MAP_WALLS = Pose(3.0, -2.0, 0.7)


def body(x: float, y: float) -> Array:
    """Walls (N, 4) [m] of a round robot."""
    turn = np.linspace(0.0, 2.0 * np.pi, 17)
    ring = np.column_stack([x + RADIUS * np.cos(turn), y + RADIUS * np.sin(turn)])
    return np.column_stack([ring[:-1], ring[1:]])


def returns(scan: Scan) -> Array:
    """Places (K, 2) of the returns of a scan, in the room."""
    return apply(HERE, cloud(scan, 30.0).outline.hits)


def test_a_body_is_left_out_of_a_scan_and_the_walls_are_not() -> None:
    seen = fake_scan(np.concatenate([ROOM, body(3.0, 1.6)]), HERE)
    alone = fake_scan(ROOM, HERE)
    hidden = Bodies(np.array([(3.0, 1.6)]), RADIUS + 0.1).hide(seen, HERE)
    near = np.hypot(*(returns(seen) - (3.0, 1.6)).T) < RADIUS + 0.1
    assert near.sum() > 20
    assert not (np.hypot(*(returns(hidden) - (3.0, 1.6)).T) < RADIUS + 0.1).any()
    assert len(returns(hidden)) == (~near).sum()
    bodies = Bodies(np.array([(3.0, 1.6)]), 0.35)
    assert np.array_equal(bodies.hide(alone, HERE).ranges, alone.ranges)


def test_nobody_around_changes_nothing() -> None:
    scan = fake_scan(ROOM, HERE)
    assert Bodies(np.empty((0, 2)), 0.5).hide(scan, HERE) is scan


def test_the_beams_that_met_a_body_free_nothing_behind_it() -> None:
    seen = fake_scan(np.concatenate([ROOM, body(3.0, 1.6)]), HERE)
    hidden = Bodies(np.array([(3.0, 1.6)]), RADIUS + 0.1).hide(seen, HERE)
    rim = apply(HERE, cloud(hidden, 30.0).outline.rim)
    beyond = np.hypot(*(rim - HERE[:2]).T) > 1.6
    away = np.arctan2(*(rim - HERE[:2]).T[::-1]) - np.arctan2(0.1, 1.5)
    assert not (beyond & (np.abs(away) < 0.1)).any()


def seen_by_two() -> dict[str, SharedMap]:
    """Map a room by robots a and b; each sees c, which has driven through, as a wall."""
    grid = fake_grid(np.concatenate([ROOM, body(3.0, 1.6)]))
    driven = [(x, 1.6) for x in np.arange(1.5, 5.0, 0.1)]
    own = SharedMap(fake_grid(ROOM, T_map_walls=T_MAP_WALLS))
    path = apply(T_MAP_WALLS, np.array(driven))
    return {'a': SharedMap(grid), 'b': SharedMap(grid),
            'c': SharedMap.from_cells(mark_driven(own.to_cells(), path))}


def walls_near_body(merged: object) -> int:
    """Count the wall cells where c stood."""
    points = merged.points(merged.occupied)
    return int((np.hypot(*(points - (3.0, 1.6)).T) < RADIUS + 0.1).sum())


def test_a_body_that_two_others_saw_is_no_wall_in_the_merged_map() -> None:
    maps = seen_by_two()
    poses = {'a': Pose(), 'b': Pose(), 'c': Pose.from_array(inverse(T_MAP_WALLS))}
    grids = {name: shared.grid for name, shared in maps.items()}
    driven = {name: shared.driven for name, shared in maps.items()}
    assert walls_near_body(merge_grids(grids, poses)) > 10
    clean = merge_grids(grids, poses, driven=driven, robot_radius=RADIUS + 0.1)
    assert walls_near_body(clean) == 0
    both = merge_grids({'a': fake_grid(ROOM), 'c': grids['c']}, poses)
    assert clean.occupied.sum() > 0.98 * both.occupied.sum()   # walls beside the path stay


def test_a_wall_beside_a_path_stays_where_the_driver_sees_it_too() -> None:
    own = SharedMap(fake_grid(ROOM))
    close = [(x, 0.2) for x in np.arange(1.0, 7.0, 0.1)]   # along a wall, one body's breadth away
    driven = SharedMap.from_cells(mark_driven(own.to_cells(), close)).driven
    merged = merge_grids({'a': fake_grid(ROOM), 'c': own.grid}, {'a': Pose(), 'c': Pose()},
                         driven={'c': driven}, robot_radius=0.5)
    assert merged.occupied.sum() == fake_grid(ROOM).occupied.sum()


def test_a_map_of_scans_without_the_body_has_no_wall_there() -> None:
    slam = Slam()
    for step in range(12):
        pose = compose(HERE, (0.08 * step, 0.0, 0.0))
        scan = fake_scan(np.concatenate([ROOM, body(4.5, 2.6)]), pose, 0.1 * step)
        place = apply(inverse(HERE), np.array([(4.5, 2.6)]))
        T_map_base = Pose(0.08 * step, 0.0, 0.0)
        slam.process(scan, Odometry(0.1 * step, np.array(T_map_base), np.zeros(3)),
                     Bodies(place, RADIUS + 0.15))
    grid = slam.grid()
    away = np.hypot(*(grid.points(grid.occupied) - place[0]).T)
    assert grid.occupied.sum() > 100
    assert not (away < RADIUS + 0.1).any()
