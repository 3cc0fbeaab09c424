"""Digests of the code of tasks, computed once a run; normalised sources are cached for all runs."""

import contextlib
import json
from pathlib import Path
from typing import Any

from objectfolder.products.atomic import atomic_write
from objectfolder.products.provenance import code_identity


class TaskCode:
    """Code identities as of the first request; losing their cache costs time only.

    Parameters
    ----------
    root
        Root of the data set; what is known of sources lies in its ``.objectfolder/code.json``.
    """

    def __init__(self, root: Path) -> None:
        self._path = _path(root)
        self._known = known_sources(root)
        self._kept = set(self._known)
        self._identities: dict[str, dict[str, str]] = {}

    def identity(self, module: str) -> dict[str, str]:
        """Return digests of a task's module and of all that it imports (see `code_identity`).

        Raises
        ------
        InputError
            `module` is not found.
        """
        if module not in self._identities:
            self._identities[module] = code_identity(module, self._known)
        return self._identities[module]

    def save(self) -> None:
        """Write the cache of sources, if it has grown; on a full disk it is lost."""
        if set(self._known) == self._kept:
            return
        with contextlib.suppress(OSError), atomic_write(self._path) as file:
            file.write(json.dumps(self._known).encode())
        self._kept = set(self._known)


def known_sources(root: Path) -> dict[str, Any]:
    """Return what earlier runs found in sources, by their content (see `code_identity`)."""
    return {key: entry for key, entry in read_cache(_path(root)).items() if _is_normalised(entry)}


def _path(root: Path) -> Path:
    return root / ".objectfolder" / "code.json"


def read_cache(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file that may be lost at any time: empty where it holds no object."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _is_normalised(entry: Any) -> bool:
    """Whether `entry` is a digest and what a source mentions, as `code_identity` keeps them."""
    if not (isinstance(entry, list) and len(entry) == 2 and isinstance(entry[0], str)):
        return False
    return isinstance(entry[1], list) and all(
        isinstance(mention, list) and len(mention) == 2 and all(isinstance(name, str) for name in mention)
        for mention in entry[1]
    )
