"""The file that the tests of downloads fetch, and how often they try."""

import hashlib
import random
from pathlib import Path
from typing import Any

CONTENT = random.Random(1).randbytes(300_000)
MD5 = hashlib.md5(CONTENT).hexdigest()
# The machine may be busy: what is to succeed has much time, and only what is to fail has little.
AMPLE: dict[str, Any] = {"retries": 20, "timeout_s": 30.0, "backoff_s": 0.01}
SHORT: dict[str, Any] = {"retries": 1, "timeout_s": 0.2, "backoff_s": 0.01}


def whole_files(cache: Path) -> list[Path]:
    """Files in a cache that have their final name."""
    return [path for path in cache.rglob("*") if path.is_file() and not path.name.startswith(".")]
