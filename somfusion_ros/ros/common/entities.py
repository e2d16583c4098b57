# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""What a node creates in one state of its life cycle, to be destroyed when the state is left."""

from collections.abc import Callable
from typing import Any


class Entities:
    """
    Stands for a node towards its parts, and remembers what they create through it.

    All else, such as the logger and the clock, is the node's own.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._made: dict[int, tuple[Callable[[Any], Any], Any]] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)

    def create_publisher(self, *args: Any, **options: Any) -> Any:
        """Create a publisher of the node."""
        return self._keep(self._node.destroy_publisher,
                          self._node.create_publisher(*args, **options))

    def create_subscription(self, *args: Any, **options: Any) -> Any:
        """Create a subscription of the node."""
        return self._keep(self._node.destroy_subscription,
                          self._node.create_subscription(*args, **options))

    def create_service(self, *args: Any, **options: Any) -> Any:
        """Create a service of the node."""
        return self._keep(self._node.destroy_service, self._node.create_service(*args, **options))

    def create_timer(self, *args: Any, **options: Any) -> Any:
        """Create a timer of the node."""
        return self._keep(self._node.destroy_timer, self._node.create_timer(*args, **options))

    def destroy_publisher(self, made: Any) -> None:
        """Destroy one publisher before the others."""
        self._destroy(made)

    def destroy_subscription(self, made: Any) -> None:
        """Destroy one subscription before the others."""
        self._destroy(made)

    def destroy_all(self) -> None:
        """Destroy everything, the newest first."""
        for _, made in reversed(list(self._made.values())):
            self._destroy(made)

    def _keep(self, destroy: Callable[[Any], Any], made: Any) -> Any:
        self._made[id(made)] = destroy, made
        return made

    def _destroy(self, made: Any) -> None:
        destroy, _ = self._made.pop(id(made))
        destroy(made)
