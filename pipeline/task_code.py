"""What the code of tasks is, found once a run, its sources normalised once for all runs."""

import json
from pathlib import Path
from typing import Any

from objectfolder.atomic import atomic_write
from objectfolder.provenance import code_identity


class TaskCode:
    """Code identities as of their first asking; losing what is kept of them costs time only.

    Parameters
    ----------
    root
        Root of the data set; what is known of sources lies in its ``.objectfolder/code.json``.
    """

    def __init__(self, root: Path) -> None:
        self._path = root / ".objectfolder" / "code.json"
        try:
            known = json.loads(self._path.read_bytes())
        except (OSError, ValueError):
            known = None
        self._known: dict[str, Any] = known if isinstance(known, dict) else {}
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
        """Keep what is known of sources for the next run, if it is more than before."""
        if set(self._known) != self._kept:
            with atomic_write(self._path) as file:
                file.write(json.dumps(self._known).encode())
            self._kept = set(self._known)
