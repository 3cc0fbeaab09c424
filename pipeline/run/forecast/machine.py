"""How fast this machine is now, beside the one whose costs are packaged."""

import random
import time
import zlib
from functools import cache

REFERENCE_S = (
    0.054  # CPU seconds of what is timed here, where the packaged costs of the starter set were taken
)
TIMES, BYTES = 8, 1 << 18


@cache
def slowness() -> float:
    """Return how many CPU seconds this machine needs for one of the packaged costs.

    The time of compressing random bytes tells it within a fifth. Other work on the machine makes CPU seconds
    longer, too, by what caches and cores share.
    """
    data = random.Random(0).randbytes(BYTES)
    begin_s = time.thread_time()
    for _ in range(TIMES):
        zlib.compress(data)
    return (time.thread_time() - begin_s) / REFERENCE_S
