# Copyright 2026 The somfusion_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
A network switch that loses, doubles, delays and disorders frames, as bad radio links do.

A process of its own: it hands Ethernet frames on between the interfaces that it is given. Lines
of JSON on stdin set `loss`, `duplicate` and `reorder` (chances per frame), `rate` (bit/s towards
each port, 0: no limit) and `groups` (lists of ports that reach one another, empty: all do). Each
is answered with one line: bytes that came from each port so far.
"""

import ctypes
import fcntl
import heapq
import json
import random
import selectors
import socket
import struct
import sys
import time

ALL_PROTOCOLS = 0x0003
OUTGOING = 4             # packet type of frames that this host sends itself
GROUP = 0x01             # bit of an address that stands for many
BUFFER = 1 << 22         # bytes
QUEUE = 1 << 17          # bytes that wait for a slow port before frames are lost
HELD = (0.002, 0.05)     # [s] that a frame is held back to disorder the others
POLL = 0.05              # [s]
SIOCETHTOOL, SET_TX_CHECKSUM = 0x8946, 0x17   # of Linux: <linux/sockios.h>, <linux/ethtool.h>


class Switch:
    """Ports, the settings of the links, and frames that wait for their time."""

    def __init__(self, interfaces: list[str]) -> None:
        self.ports = [_open(name) for name in interfaces]
        self.settings = {'loss': 0.0, 'duplicate': 0.0, 'reorder': 0.0, 'rate': 0.0, 'groups': []}
        self._learned: dict[bytes, int] = {}   # at which port an address was heard
        self.received = [0] * len(self.ports)
        self._free_at = [0.0] * len(self.ports)
        self._waiting: list[tuple[float, int, int, bytes]] = []
        self._random, self._count = random.Random(1), 0

    def take(self, port: int) -> None:
        """Hand on one frame that came in at a port."""
        frame, address = self.ports[port].recvfrom(65535)
        if address[2] == OUTGOING:
            return
        self.received[port] += len(frame)
        self._learned[frame[6:12]] = port
        known = None if frame[0] & GROUP else self._learned.get(frame[:6])
        for other in range(len(self.ports)) if known is None else (known,):
            if other != port and self._connected(port, other) and not self._chance('loss'):
                for _ in range(1 + self._chance('duplicate')):
                    self._send(other, frame)

    def flush(self) -> float:
        """Send what is due; return the time [s] until the next frame is."""
        now = time.monotonic()
        while self._waiting and self._waiting[0][0] <= now:
            _, _, port, frame = heapq.heappop(self._waiting)
            try:
                self.ports[port].send(frame)
            except OSError:   # the robot at this port is gone
                pass
        return min(POLL, max(0.0, self._waiting[0][0] - now)) if self._waiting else POLL

    def _send(self, port: int, frame: bytes) -> None:
        """Let a frame wait for its turn at a port."""
        due = time.monotonic()
        if self.settings['rate']:
            start, seconds = max(due, self._free_at[port]), 8.0 / self.settings['rate']
            if (start - due) / seconds > QUEUE:
                return
            due = self._free_at[port] = start + len(frame) * seconds
        if self._chance('reorder'):
            due += self._random.uniform(*HELD)
        self._count += 1
        heapq.heappush(self._waiting, (due, self._count, port, frame))

    def _connected(self, port: int, other: int) -> bool:
        """Tell whether two ports reach one another."""
        groups = self.settings['groups']
        return not groups or any(port in group and other in group for group in groups)

    def _chance(self, name: str) -> bool:
        """Throw the dice."""
        return bool(self.settings[name]) and self._random.random() < self.settings[name]


def _open(interface: str) -> socket.socket:
    """Open an interface for whole frames."""
    port = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ALL_PROTOCOLS))
    port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
    port.bind((interface, 0))
    return port


def compute_checksums(interface: str) -> None:
    """Have checksums computed before frames leave: a switch in between needs them."""
    command = ctypes.create_string_buffer(struct.pack('II', SET_TX_CHECKSUM, 0))
    request = struct.pack('16sP', interface.encode(), ctypes.addressof(command))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        fcntl.ioctl(any_socket, SIOCETHTOOL, request)


def main() -> None:
    """Run until stdin ends."""
    if sys.argv[1] == '--compute-checksums':
        compute_checksums(sys.argv[2])
        return
    switch, selector = Switch(sys.argv[1:]), selectors.DefaultSelector()
    for number, port in enumerate(switch.ports):
        selector.register(port, selectors.EVENT_READ, number)
    selector.register(sys.stdin, selectors.EVENT_READ, None)
    while True:
        for key, _ in selector.select(switch.flush()):
            if key.data is not None:
                switch.take(key.data)
                continue
            line = sys.stdin.readline()
            if not line:
                return
            switch.settings |= json.loads(line)
            sys.stdout.write(json.dumps(switch.received) + '\n')
            sys.stdout.flush()


if __name__ == '__main__':
    main()
