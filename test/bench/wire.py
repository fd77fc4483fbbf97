"""
A line between two network interfaces that delays and loses frames, for kernels without netem.

`wire.py relay '[delay ms, jitter ms, loss %]' ONE OTHER` forwards every frame between two interfaces of this network
namespace. `wire.py plain eth` makes the far end of such an interface send frames that a program can forward: with
checksums, and no larger than the MTU.
"""

import ctypes
import fcntl
import json
import random
import select
import socket
import struct
import sys
from heapq import heappop, heappush
from itertools import count
from time import monotonic

_SIOCETHTOOL = 0x8946
# linux/ethtool.h: transmit checksums, scatter-gather, TCP and generic segmentation offload
_OFFLOADS = (0x17, 0x19, 0x1F, 0x24)
_ALL_PROTOCOLS = 3


def plain(interface):
    """Disable the offloads of a network card."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        for offload in _OFFLOADS:
            value = ctypes.create_string_buffer(struct.pack('II', offload, 0))
            fcntl.ioctl(any_socket, _SIOCETHTOOL, struct.pack('16sP', interface.encode(), ctypes.addressof(value)))


def relay(delay, jitter, loss, names):
    """Forward frames between two interfaces until interrupted; delay and jitter in ms, loss in %."""
    draw = random.Random(1)
    ends = [socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ALL_PROTOCOLS)) for _ in names]
    for end, name in zip(ends, names, strict=True):
        end.bind((name, _ALL_PROTOCOLS))
        end.setblocking(False)
    other = dict(zip(ends, reversed(ends), strict=True))
    under_way, number = [], count()
    while True:
        pause = max(0.0, under_way[0][0] - monotonic()) if under_way else None
        for end in select.select(ends, [], [], pause)[0]:
            frame, (_, _, kind, *_) = end.recvfrom(65536)
            if kind != socket.PACKET_OUTGOING and draw.uniform(0.0, 100.0) >= loss:
                due = monotonic() + 1e-3 * max(0.0, draw.gauss(delay, jitter))
                heappush(under_way, (due, next(number), frame, other[end]))
        while under_way and under_way[0][0] <= monotonic():
            *_, frame, end = heappop(under_way)
            end.send(frame)


if __name__ == '__main__':
    if sys.argv[1] == 'plain':
        plain(sys.argv[2])
    else:
        relay(*json.loads(sys.argv[2]), sys.argv[3:])
