"""A folder that is made beside its name and takes it when it is whole; one process at a time makes it."""

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from pipeline.intake.sources.vanishing_lock import vanishing_lock


@contextlib.contextmanager
def held_folder(target: Path) -> Iterator[Path]:
    """Yield an empty folder beside `target`, held against other processes until the end.

    What a killed process left is removed, and `target` is put back if it was killed while replacing it.
    Call `put` for the folder to become `target`; otherwise it is removed.
    """
    partial, old = _partial(target), _old(target)
    with vanishing_lock(target.with_name(f".lock-{target.name}")):
        if old.exists() and not target.exists():
            os.rename(old, target)
        _remove(old)
        _remove(partial)
        partial.mkdir()
        try:
            yield partial
        finally:
            _remove(partial)


def put(target: Path) -> None:
    """Let what `held_folder` yielded for `target` take its name, in place of what was there."""
    partial, old = _partial(target), _old(target)
    if target.exists() or target.is_symlink():
        os.rename(target, old)
    os.rename(partial, target)
    _remove(old)


def _partial(target: Path) -> Path:
    return target.with_name(f".partial-{target.name}")


def _old(target: Path) -> Path:
    return target.with_name(f".old-{target.name}")


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
