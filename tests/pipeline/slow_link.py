"""``python slow_link.py NAME_A NAME_B``: a cable between two taps, as poor as asked.

Makes two network interfaces and carries frames from one to the other, both ways, with the delay, rate
and loss that a line ``DELAY_S RATE_BIT_S LOSS SEED`` on standard input asks for, the last one there was;
at first as fast as it can. It does what ``tc netem`` does, which not every kernel has, and needs no
privilege beyond that over a network namespace of one's own.
"""

import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time

TUNSETIFF, IFF_TAP, IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
LONGEST_FRAME = 65536
LONGEST_QUEUE_S = 4.0  # seconds of sending that may wait, as in the buffer of a modem


def tap(name: str) -> int:
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TAP | IFF_NO_PI))
    return descriptor


def carry(ends: tuple[int, int]) -> None:
    """Carry frames until standard input ends, each direction with the rate and delay of its own."""
    orders = sys.stdin.fileno()
    delay_s, rate_bit_s, loss, chance = 0.0, 1e12, 0.0, random.Random(0)
    sent_by = {end: 0.0 for end in ends}  # when the cable is done with what it was given at this end
    due: list[tuple[float, int, int, bytes]] = []
    count = 0
    while True:
        patience = max(0.0, due[0][0] - time.monotonic()) if due else None
        readable, _, _ = select.select([orders, *ends], [], [], patience)
        now = time.monotonic()
        if orders in readable:
            line = os.read(orders, 200).split()
            if not line:
                return
            delay_s, rate_bit_s, loss = map(float, line[-4:-1])
            chance = random.Random(int(line[-1]))
        for end in set(readable) - {orders}:
            frame = os.read(end, LONGEST_FRAME)
            begin = max(now, sent_by[end])
            if chance.random() < loss or begin - now > LONGEST_QUEUE_S:
                continue
            sent_by[end] = begin + 8 * len(frame) / rate_bit_s
            count += 1
            far_end = ends[1] if end == ends[0] else ends[0]
            heapq.heappush(due, (sent_by[end] + delay_s, count, far_end, frame))
        while due and due[0][0] <= now:
            _, _, end, frame = heapq.heappop(due)
            try:
                os.write(end, frame)
            except OSError:  # an interface that is down loses what arrives
                continue


if __name__ == "__main__":
    taps = (tap(sys.argv[1]), tap(sys.argv[2]))
    print("ready", flush=True)
    carry(taps)
