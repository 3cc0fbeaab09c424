"""A cache by size, time and inode of files, so that each file is read whole only once.

A product was checked whole, carries a fingerprint and a few attributes that later stages go by; a source
file has a digest. All of it can be read again from the files themselves.
"""

import contextlib
import json
import operator
import os
import time
from collections.abc import Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError
from objectfolder.products.atomic import atomic_write
from objectfolder.products.provenance import file_digest
from pipeline.dataset import products
from pipeline.dataset.task_code import TaskCode, read_cache

FINGERPRINT = "fingerprint"
# A file that changed this shortly ago can change again without its time telling.
SETTLED_S = 2.0


class Verified:
    """A cache beside the data set; losing it costs time only.

    Parameters
    ----------
    root
        Root of the data set.
    """

    def __init__(self, root: Path) -> None:
        self.code = TaskCode(root)
        self._prefix = f"{root}{os.sep}"
        self._path = root / ".objectfolder" / "verified.json"
        kept = read_cache(self._path)
        # By path: state, then for a product whether it was checked, and attributes; for a source its digest.
        self._products = _entries(kept.get("products"), {"state": list, "whole": bool, "attributes": dict})
        self._sources = _entries(kept.get("sources"), {"state": list, "digest": str})
        self._changed = False

    def attributes(self, path: Path, names: Sequence[str]) -> dict[str, Any]:
        """Return attributes of a product by their dotted names.

        Raises
        ------
        FileNotFoundError
            There is no product.
        FormatError
            A file that cannot be read, or lacks one of them.
        """
        entry = self._product(path)
        known: dict[str, Any] = entry["attributes"]
        if not known.keys() >= set(names):
            found = products.read_description(path)
            try:
                known |= {name: reduce(operator.getitem, name.split("."), found) for name in names}
            except (KeyError, TypeError) as error:
                finding = f"it carries no {error.args[0]}"
                raise FormatError(str(path), finding, "Delete it; a run makes it again.") from error
            self._changed = True
        return {name: known[name] for name in names}

    def holds(self, path: Path, fingerprint: str) -> bool:
        """Whether `path` is a whole product with this fingerprint."""
        try:
            if self.attributes(path, (FINGERPRINT,))[FINGERPRINT] != fingerprint:
                return False
            entry = self._product(path)
            if not entry["whole"]:
                products.verify(path)
                entry["whole"] = self._changed = True
        except (FileNotFoundError, FormatError):
            return False
        return True

    def add(self, path: Path, fingerprint: str | None = None) -> None:
        """Note a product as checked, its fingerprint with it where that is known."""
        entry = self._product(path)
        entry["whole"] = self._changed = True
        if fingerprint is not None:
            entry["attributes"][FINGERPRINT] = fingerprint

    def source_digest(self, path: Path) -> str:
        """Return the SHA-256 of a source file.

        Raises
        ------
        OSError
            A file that cannot be read.
        """
        key = self._key(path)
        now = time.time()
        state = _state(path)
        entry = self._sources.get(key)
        if entry is not None and entry["state"] == state:
            return str(entry["digest"])
        digest = file_digest(path)
        if now - state[1] / 1e9 > SETTLED_S:
            self._sources[key] = {"state": state, "digest": digest}
            self._changed = True
        return digest

    def save(self) -> None:
        """Write the cache, without removed files; on a full disk it is lost."""
        self.code.save()
        if not self._changed:
            return
        kept = {
            kind: {key: entry for key, entry in entries.items() if os.path.exists(self._place(key))}
            for kind, entries in (("products", self._products), ("sources", self._sources))
        }
        with contextlib.suppress(OSError), atomic_write(self._path) as file:
            file.write(json.dumps(kept).encode())
        self._changed = False

    def _product(self, path: Path) -> dict[str, Any]:
        """Return the cache's entry of a product; a new one if its file has changed."""
        key = self._key(path)
        state = _state(path)
        entry = self._products.get(key)
        if entry is None or entry["state"] != state:
            entry = self._products[key] = {"state": state, "whole": False, "attributes": {}}
        return entry

    def _key(self, path: Path) -> str:
        return str(path).removeprefix(self._prefix)

    def _place(self, key: str) -> str:
        return os.path.join(self._prefix, key)


def _entries(content: Any, shape: Mapping[str, type]) -> dict[str, dict[str, Any]]:
    """Return the entries of a cache that have the shape they should have."""
    if not isinstance(content, dict):
        return {}
    return {
        key: entry
        for key, entry in content.items()
        if isinstance(entry, dict) and all(isinstance(entry.get(name), kind) for name, kind in shape.items())
    }


def _state(path: Path | str) -> list[int]:
    status = os.stat(path)
    return [status.st_size, status.st_mtime_ns, status.st_ino]
