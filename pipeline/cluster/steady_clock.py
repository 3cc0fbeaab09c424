"""A clock for Dask's timers that nobody can set: after a wall clock is set back, they would wait for it.

Tornado's repeated callbacks and Dask's batches of messages are due at a wall time. This module is sent to
workers by value, as the plugin that calls it.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

from tornado.ioloop import IOLoop

PACKAGE = "distributed"


def use_steady_clock() -> None:
    """Let Dask's timers in this process go by the wall clock of now, continued by the monotonic one."""
    if hasattr(IOLoop.time, "is_steady"):
        return
    clock = _steady_clock()
    modules = [module for name, module in sys.modules.items() if name.partition(".")[0] == PACKAGE]
    owners: list[Any] = [
        IOLoop,
        *(module for module in modules if getattr(module, "time", None) is time.time),
    ]
    for owner in owners:
        owner.time = clock


def _steady_clock() -> Callable[..., float]:
    ahead_s = time.time() - time.monotonic()

    def clock(*_: object) -> float:
        return time.monotonic() + ahead_s

    clock.is_steady = True  # type: ignore[attr-defined]
    return clock
