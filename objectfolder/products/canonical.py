"""One JSON text of a value, for files and fingerprints that are compared byte for byte."""

import json
from typing import Any

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def canonical_json(value: Any) -> str:
    """Return the one JSON text of `value`: sorted keys, no spaces, no NaN.

    Raises
    ------
    TypeError, ValueError
        A value that JSON cannot hold.
    """
    return _CANONICAL.encode(value)
