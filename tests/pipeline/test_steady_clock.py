"""Dask's timers while the wall clock is set back."""

import asyncio
import time

from distributed import batched
from tornado.ioloop import PeriodicCallback

from pipeline.cluster.steady_clock import use_steady_clock

PERIOD_MS = 10
JUMP_S = 3600.0


def test_timers_go_on_after_the_wall_clock_is_set_back(monkeypatch):
    use_steady_clock()
    wall_clock, before = time.time, batched.time()
    assert abs(before - wall_clock()) < JUMP_S / 2

    async def calls_after_a_jump() -> None:
        reached = asyncio.Event()
        calls = iter((False, False, True))  # after the first, Tornado would wait for an hour
        timer = PeriodicCallback(lambda: next(calls, True) and reached.set(), PERIOD_MS)
        timer.start()
        monkeypatch.setattr(time, "time", lambda: wall_clock() - JUMP_S)
        await asyncio.wait_for(reached.wait(), 60.0)
        timer.stop()

    asyncio.run(calls_after_a_jump())
    assert hasattr(batched.time, "is_steady")
    use_steady_clock()  # another run in this process: the clock goes on as it was
    assert batched.time() >= before
