"""The shared store behind DVC's cache: a cache, too, so a run continues without it where it fails.

It says so once, does not use the store for a while and then tries again. Names of products that could
not be shared wait in ``.objectfolder/outbox``, and the end of a run settles them, be it the next run's.
"""

import contextlib
import functools
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from objectfolder.products.atomic import write_whole
from pipeline.dataset import products
from pipeline.dataset.validation import number_of
from pipeline.store.storage import DEFAULT_PATIENCE_S, PATIENCE, STORE, Store

PATIENCE_S = 20.0  # for what a run can do without
REST_S = 60.0
OUTBOX = "outbox"


class Cache:
    """A store that may fail."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._store: Store | None = None
        self._rests_until, self._warned = 0.0, False

    def attempt(self, action: Callable[..., object], *arguments: object) -> bool:
        """Call a method of `Store`; return False where it does so or fails.

        Raises
        ------
        InputError
            A store that cannot be used as it is named.
        """
        if time.monotonic() < self._rests_until:
            return False
        try:
            if self._store is None:
                store = Store(self._url, min(PATIENCE_S, number_of(PATIENCE, DEFAULT_PATIENCE_S)))
                store.check()
                self._store = store
            return action(self._store, *arguments) is not False
        except ObjectFolderError as error:
            if self._store is None and isinstance(error, InputError):
                raise
            self._rests_until = time.monotonic() + REST_S
            if not self._warned:
                finding = f"{error.where}: {error.finding}"
                print(f"warning: {finding}; the run goes on without it", file=sys.stderr)
            self._warned = True
            return False


def share(state: Path, name: str, path: Path) -> None:
    """Put a product into the shared store, if there is one; what fails waits in the outbox under `state`."""
    if (cache := _cache()) is None:
        return
    note = state / OUTBOX / name.replace("/", ".")
    with contextlib.suppress(OSError):
        write_whole(note, f"{name}\n{path}")
    with contextlib.suppress(InputError):
        if cache.attempt(Store.put, path, name):
            note.unlink(missing_ok=True)


def fetch(names: Sequence[str], targets: Sequence[Path]) -> bool:
    """Copy products from the shared store; False unless all were there.

    Raises
    ------
    InputError
        A store that cannot be used as it is named.
    """
    cache = _cache()
    return cache is not None and cache.attempt(Store.get_all, names, targets)


def discard(names: Sequence[str]) -> None:
    """Remove damaged products from the shared store."""
    if (cache := _cache()) is not None:
        for name in names:
            cache.attempt(Store.remove, name)


def settle(state: Path) -> None:
    """Put what waits in the outbox under `state` into the shared store."""
    if (cache := _cache()) is None:
        return
    waiting = 0
    for note in sorted((state / OUTBOX).glob("[0-9a-f]*")):
        try:
            name, _, path = note.read_text().partition("\n")
        except OSError:
            continue  # another run settled it
        if not _stands(Path(path), name.split("/")[1]) or cache.attempt(Store.put, Path(path), name):
            note.unlink(missing_ok=True)
        else:
            waiting += 1
    if waiting:
        print(f"warning: {waiting} products are not in {os.environ[STORE]} yet; a later run puts them there",
              file=sys.stderr)  # fmt: skip


def _stands(path: Path, fingerprint: str) -> bool:
    """Whether a file is still the product with this fingerprint."""
    with contextlib.suppress(FormatError):
        return products.read_fingerprint(path) == fingerprint
    return False


def _cache() -> Cache | None:
    url = os.environ.get(STORE)
    return _cache_at(url) if url else None


_cache_at = functools.cache(Cache)
