"""Where the partitions of a long table lie in a checkout, and which of them an object goes to."""

import hashlib
import re
from pathlib import Path

FOLDER = Path("partitions")
NAME = re.compile(r"\d{3}")


def folders(root: Path) -> list[Path]:
    """Return the folders of the partitions of a checkout, in order; none where it is one data set."""
    return sorted(path.parent for path in (root / FOLDER).glob("[0-9][0-9][0-9]/dvc.yaml"))


def data_sets(root: Path) -> list[Path]:
    """Return the folders that have products of their own: the partitions, else the checkout itself."""
    return folders(root) or [root]


def partition_number(object_id: str, count: int) -> int:
    """Return the partition of an object. Ids that differ in case alone share it: they are at fault there."""
    digest = hashlib.sha256(object_id.casefold().encode()).digest()
    return int.from_bytes(digest[:8], "big") * count >> 64


def inside(path: str) -> str:
    """Return a path of a checkout as its own data set has it.

    Examples
    --------
    >>> inside("partitions/003/data/views"), inside("data/views")
    ('data/views', 'data/views')
    """
    parts = path.split("/", 2)
    in_partition = parts[0] == str(FOLDER) and len(parts) > 2 and NAME.fullmatch(parts[1])
    return parts[2] if in_partition else path
