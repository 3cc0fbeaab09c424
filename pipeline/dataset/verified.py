"""A cache by size, time and inode of files, so that each file is read whole only once.

A product was checked whole, carries a fingerprint and a few attributes that later stages go by; a source
file, and a product that a report shows, has a digest; code has digests. All of it can be read again from the
files themselves.
"""

import contextlib
import errno
import functools
import gc
import operator
import os
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter
from pydantic_core import to_json

from objectfolder.errors import FormatError
from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import Constant, code_identity, file_digest
from objectfolder.products.regular_file import irregular, read_regular
from pipeline.dataset import products
from pipeline.dataset.archives import REMEDY

FINGERPRINT = "fingerprint"
# A file that changed this shortly ago can change again without its time telling.
SETTLED_S = 2.0

Kind = TypeVar("Kind")
State = tuple[int, int, int]  # bytes, time of the last change, inode
Sources = dict[str, tuple[str, list[tuple[str, str]]]]  # see `code_identity`


@dataclass
class _Product:
    """Attributes that were read of a product, whether all of it was checked, and the MD5 of its bytes."""

    state: State
    whole: bool = False
    md5: str = ""
    attributes: dict[str, Any] = field(default_factory=dict)


@dataclass
class _Kept:
    """Products, and states and digests of source files, by path."""

    products: dict[str, _Product] = field(default_factory=dict)
    sources: dict[str, tuple[State, str]] = field(default_factory=dict)


class Verified:
    """A cache beside the data set at `root`; losing it costs time only.

    Parameters
    ----------
    root
        Of the data set.
    momentary
        Whether each product is looked at once: for what is said of a moment, in which nothing is made.
    """

    def __init__(self, root: Path, *, momentary: bool = False) -> None:
        self._looks: dict[str, _Product] | None = {} if momentary else None
        self._prefix = f"{root}{os.sep}"
        self._path, self._code_path = root / ".objectfolder" / "verified.json", _code_path(root)
        self._kept, self._code = _read(self._path, _Kept), known_sources(root)
        self._changed, self._saved_sources = False, len(self._code)
        self._identities: dict[str, Constant] = {}

    @contextlib.contextmanager
    def moment(self) -> Iterator[None]:
        """Look at each product once meanwhile: nothing is made, and what changes is seen by a later look."""
        before, self._looks = self._looks, {}
        try:
            yield
        finally:
            self._looks = before

    def code_identity(self, module: str) -> Constant:
        """Return digests of a task's module and all that it imports, as of the first request.

        Raises
        ------
        InputError
            `module` is not found.
        """
        if module not in self._identities:
            self._identities[module] = Constant(code_identity(module, self._code))
        return self._identities[module]

    def attributes(self, path: Path, names: Sequence[str]) -> dict[str, Any]:
        """Return attributes of a product by their dotted names.

        Raises
        ------
        FileNotFoundError
            There is no product.
        FormatError
            A file that cannot be read, or lacks one of them.
        """
        return self._attributes(self._product(path), path, names)

    def _attributes(self, entry: _Product, path: Path | str, names: Sequence[str]) -> dict[str, Any]:
        attributes = entry.attributes
        if not attributes.keys() >= set(names):
            description = products.read_description(Path(path))
            try:
                attributes |= {
                    name: functools.reduce(operator.getitem, name.split("."), description) for name in names
                }
            except (KeyError, TypeError) as error:
                finding = f"it carries no {error.args[0]}"
                raise FormatError(str(path), finding, REMEDY) from error
            self._changed = True
        return {name: attributes[name] for name in names}

    def holds(self, path: Path, fingerprint: str) -> bool:
        """Whether `path` is a whole product with this fingerprint."""
        try:
            entry = self._product(path)
            if self._attributes(entry, path, (FINGERPRINT,))[FINGERPRINT] != fingerprint:
                return False
            if not entry.whole:
                products.verify(path)
                entry.whole = self._changed = True
        except (FileNotFoundError, FormatError):
            return False
        return True

    def md5(self, path: Path | str) -> str:
        """Return the MD5 of a product's bytes.

        Raises
        ------
        FileNotFoundError
            There is no product.
        FormatError
            It is no regular file.
        """
        return self._md5(self._product(path), path)

    def _md5(self, entry: _Product, path: Path | str) -> str:
        if not entry.md5:
            entry.md5 = products.md5_of(path)
            self._changed = True
        return entry.md5

    def identity(self, path: Path | str) -> tuple[str, str, int]:
        """Return a product's fingerprint, the MD5 of its bytes, and their number, of one look at it.

        Raises
        ------
        FileNotFoundError
            There is no product.
        FormatError
            A file that cannot be read, or lacks a fingerprint.
        """
        entry = self._product(path)
        fingerprint = self._attributes(entry, path, (FINGERPRINT,))[FINGERPRINT]
        return fingerprint, self._md5(entry, path), entry.state[0]

    def md5s(self, paths: Iterable[Path | str]) -> list[str]:
        """Return the MD5 of each of these products, empty for what is no file; many are read at once."""
        digests: list[str] = []
        unknown: dict[int, Path | str] = {}
        for index, path in enumerate(paths):
            try:
                digests.append(self._product(path).md5)
                if not digests[-1]:
                    unknown[index] = path
            except (FileNotFoundError, FormatError):
                digests.append("")
        if unknown:
            with ThreadPoolExecutor() as pool:
                for index, digest in zip(unknown, pool.map(self.md5, unknown.values()), strict=True):
                    digests[index] = digest
        return digests

    def add(self, path: Path, fingerprint: str) -> None:
        """Note a product with this fingerprint as checked."""
        entry = self._product(path)
        entry.whole = self._changed = True
        entry.attributes[FINGERPRINT] = fingerprint

    def source_digest(self, path: Path | str, read: Callable[[Path | str], str] = file_digest) -> str:
        """Return the SHA-256 of a source file, or another digest that is always read of this file.

        Raises
        ------
        OSError
            A file that cannot be read, and whatever `read` raises.
        """
        key, now, state = self._key(path), time.time(), _state(os.stat(path))
        old_state, digest = self._kept.sources.get(key, (None, ""))
        if old_state == state:
            return digest
        digest = read(path)
        if now - state[1] / 1e9 > SETTLED_S:
            self._kept.sources[key] = state, digest
            self._changed = True
        return digest

    def save_code(self) -> None:
        """Write what is known of sources, if it has grown; on a full disk it is lost."""
        if len(self._code) > self._saved_sources:
            _write(self._code_path, self._code)
            self._saved_sources = len(self._code)

    def save(self) -> None:
        """Write the cache, without removed files; on a full disk it is lost."""
        self.save_code()
        if not self._changed:
            return
        folders: dict[str, set[str]] = {}  # one look at each is cheaper than one at each file
        for entries in (self._kept.products, self._kept.sources):
            for key in list(entries):
                folder, _, name = key.rpartition(os.sep)
                if folder not in folders:
                    path = os.path.join(self._prefix, folder)
                    folders[folder] = set(os.listdir(path)) if os.path.isdir(path) else set()
                if name not in folders[folder]:
                    del entries[key]
        _write(self._path, self._kept)
        self._changed = False

    def _product(self, path: Path | str) -> _Product:
        """Return the cache's entry of a product; a new one if its file has changed."""
        key = self._key(path)
        if self._looks and key in self._looks:
            return self._looks[key]
        try:
            status = os.stat(path)
        except OSError as error:
            if error.errno != errno.ELOOP:
                raise
            raise FormatError(str(path), "is a link to itself", REMEDY) from error
        if kind := irregular(status.st_mode):
            raise FormatError(str(path), f"is {kind}, not a file", REMEDY)
        state = _state(status)
        entry = self._kept.products.get(key)
        if entry is None or entry.state != state:
            entry = self._kept.products[key] = _Product(state)
        if self._looks is not None:
            self._looks[key] = entry
        return entry

    def _key(self, path: Path | str) -> str:
        return str(path).removeprefix(self._prefix)


def known_sources(root: Path) -> Sources:
    """Return what earlier runs found in sources, by their content (see `code_identity`)."""
    return _read(_code_path(root), Sources)


def _code_path(root: Path) -> Path:
    return root / ".objectfolder" / "code.json"


@contextlib.contextmanager
def without_collector() -> Iterator[None]:
    """Keep Python's collector of cycles from going through thousands of entries, of which none is in one."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


@without_collector()
def _read(path: Path, kind: type[Kind]) -> Kind:
    """Return the content of a file that may be lost at any time: empty where it is not of this kind."""
    try:
        return TypeAdapter(kind).validate_json(read_regular(path))
    except (OSError, ValueError):
        return kind()


def _write(path: Path, content: object) -> None:
    with contextlib.suppress(OSError):
        write_whole(path, to_json(content))


def _state(status: os.stat_result) -> State:
    return status.st_size, status.st_mtime_ns, status.st_ino
