# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The mount of the laser out of a chain of transforms, as robots publish them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from somfusion_ros.geometry import Pose
from somfusion_ros.io.frame_tree import FrameTree

LEVEL, DOWN = (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)


def transform(parent: str, child: str, x: float = 0.0, y: float = 0.0, yaw: float = 0.0,
              rotation: tuple[float, ...] | None = None) -> Any:
    """Return as much of a TransformStamped as is read."""
    q = rotation or (0.0, 0.0, float(np.sin(0.5 * yaw)), float(np.cos(0.5 * yaw)))
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=parent), child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=0.2),
            rotation=SimpleNamespace(**dict(zip('xyzw', q, strict=True)))))


def mount(*transforms: Any, base: str = 'base_link', laser: str = 'laser') -> Any:
    """Look up a mount in a tree of transforms."""
    tree = FrameTree()
    tree.add(transforms)
    return tree.mount(base, laser)


def test_a_chain_is_composed_forwards_and_backwards() -> None:
    chain = [transform('plate', 'base_link', x=-0.5), transform('plate', 'laser', y=0.1, yaw=0.3)]
    found = mount(*chain)
    assert np.allclose(found.T_base_laser, (0.5, 0.1, 0.3), atol=1e-12)
    assert not found.upside_down


def test_a_mount_that_nobody_published_is_none() -> None:
    assert mount() is None
    assert mount(transform('base_link', 'camera')) is None


def test_a_laser_at_the_base_needs_no_transform() -> None:
    assert mount(base='robot1/base_link', laser='/robot1/base_link').T_base_laser == Pose()


def test_the_usual_names_of_the_base_stand_in_for_one_another() -> None:
    assert mount(transform('r1/base_link', 'r1/laser', x=0.2), base='r1/base_footprint',
                 laser='r1/laser').T_base_laser.x == pytest.approx(0.2)


def test_the_position_of_the_robot_is_no_part_of_the_robot() -> None:
    assert mount(transform('odom', 'base_link', x=9.0), transform('odom', 'laser')) is None


def test_a_laser_that_hangs_upside_down_is_noticed() -> None:
    found = mount(transform('base_link', 'laser', rotation=DOWN))
    assert found.upside_down
    assert found.T_base_laser.theta == pytest.approx(0.0)


def test_a_tilted_laser_is_refused_by_name() -> None:
    half = np.radians(15.0)
    with pytest.raises(ValueError, match="'laser' is tilted by 30 deg"):
        mount(transform('base_link', 'laser', rotation=(np.sin(half), 0.0, 0.0, np.cos(half))))


@pytest.mark.parametrize('rotation', [(0.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 1.0)])
def test_what_is_no_rotation_is_left_out(rotation: tuple[float, ...]) -> None:
    assert mount(transform('base_link', 'laser', rotation=rotation)) is None
