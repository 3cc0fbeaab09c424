"""Descriptions of the products of any version, read from the cache or, in parts, from the remote."""

import contextlib
import json
import os
import shutil
import sqlite3
import zlib
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, cast

import diskcache

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.audit import descriptions
from pipeline.audit.descriptions import Description
from pipeline.audit.stores import FETCH, NotHere, Stores

AT_ONCE = 16  # requests to a remote
CACHED_BYTES = 256 << 20  # descriptions of about 100,000 products
RECENT = 64  # descriptions in memory: those of the object that is looked at


@dataclass(frozen=True)
class Content:
    """The content of a product: its kind, its hash, and its path if it is not in the cache.

    Parameters
    ----------
    md5
        Of its bytes.
    suffix
        `pipeline.dataset.products.ZARR` or `TENSORS`.
    where
        Its path in the version, for messages.
    path
        A file of the work tree that has these bytes.
    """

    md5: str
    suffix: str = ""
    where: str = ""
    path: Path | None = None


class Contents(Stores):
    """The contents of a data set's versions.

    Parameters
    ----------
    root
        Root of the data set.
    remote
        Name of a remote of DVC; the default one where it is empty.

    Raises
    ------
    InputError
        `root` is not under DVC.
    """

    def __init__(self, root: Path, remote: str = "") -> None:
        from dvc.exceptions import DvcException
        from dvc.repo import Repo

        self.root = root
        try:
            repository = Repo(str(root))
        except (DvcException, OSError) as error:
            raise InputError(
                str(root), f"not under DVC ({error})", "Go to the root of a data set."
            ) from error
        if Path(repository.root_dir) != root:
            remedy = f"Go to {repository.root_dir}."
            raise InputError(str(root), "not the root of the data set, but a folder in it", remedy)
        super().__init__(repository, remote)
        self._far: dict[str, Description | ObjectFolderError] = {}
        self._recent: dict[str, Description] = {}

    def __enter__(self) -> "Contents":
        return self

    def __exit__(self, *_: object) -> None:
        if "_cached" in self.__dict__:
            self._cached.close()
        self.repository.close()

    @property
    def state(self) -> Any:
        """What DVC knows of files of the work tree by size, time and inode."""
        return self.repository.state

    def place(self, content: Content, target: Path) -> None:
        """Put a content at `target`: a link where it is local, else fetched and checked.

        Raises
        ------
        NotHere
            It is neither in the cache nor at the remote.
        """
        near = content.path or self.path(content.md5)
        if near is not None:
            target.symlink_to(near.resolve())
        else:
            self.fetch(content.md5, target, content.where)

    def size(self, content: Content) -> int | None:
        """Return the bytes of a local content; None where it is not local."""
        path = content.path or self._near(content.md5)
        try:
            return os.stat(path).st_size if path is not None else None
        except OSError:
            return None

    def sizes_far(self, wanted: Iterable[str]) -> Mapping[str, int]:
        """Return the bytes of contents as the remote has them, those it has."""
        names = list(wanted)
        if not names or self.remote is None:
            return {}

        def size(md5: str) -> int | None:
            try:
                found = self.remote.fs.size(self.remote.oid_to_path(md5))
            except Exception:  # a cloud's own errors: contents of unknown size are left out
                return None
            return int(found) if found is not None else None

        with ThreadPoolExecutor(AT_ONCE) as pool:
            known = zip(names, pool.map(size, names), strict=True)
            return {md5: found for md5, found in known if found is not None}

    def describe(self, content: Content) -> Description:
        """Return the description of a product.

        Raises
        ------
        NotHere
            It is neither in the cache nor at the remote.
        FormatError
            A damaged one.
        """
        known = self._recent.get(content.md5)
        if known is None:
            known = self._describe_near(content)
            if known is None:
                self._read_far([content])
                far = self._far[content.md5]
                if isinstance(far, ObjectFolderError):
                    raise far
                return far
            if len(self._recent) >= RECENT:
                self._recent.clear()
            self._recent[content.md5] = known
        return known

    def describe_all(self, wanted: Iterable[Content]) -> None:
        """Read the descriptions of many remote products in parallel; one by one would take minutes."""
        self._read_far(one for one in wanted if one.path is None and self._near(one.md5) is None)

    def _read_far(self, wanted: Iterable[Content]) -> None:
        missing = {}
        for content in wanted:
            if content.md5 in self._far:
                continue
            known = self._cached_description(content.md5)
            if known is None:
                missing[content.md5] = content
            else:
                self._far[content.md5] = known
        if not missing:
            return
        assert self.remote is None or self.remote.fs  # opened once, before there are threads
        with ThreadPoolExecutor(AT_ONCE) as pool:
            for md5, found in zip(missing, pool.map(self._describe_far, missing.values()), strict=True):
                self._far[md5] = found
                if isinstance(found, Description):
                    packed = json.dumps(found.attributes).encode() + b"\0" + found.listing
                    with contextlib.suppress(sqlite3.Error, OSError, diskcache.Timeout):
                        self._cached.set(md5, zlib.compress(packed, 1))

    def _describe_near(self, content: Content) -> Description | None:
        path = content.path or self._near(content.md5)
        if path is None:
            return None
        try:
            with open(path, "rb", buffering=0) as near:
                size = os.fstat(near.fileno()).st_size
                return descriptions.read(cast(BinaryIO, near), size, content.suffix, content.where)
        except FileNotFoundError:
            return None  # removed just now
        except OSError as error:
            raise NotHere(content.where, f"cannot be read ({error.strerror})", FETCH) from error

    def _describe_far(self, content: Content) -> Description | ObjectFolderError:
        """Read the parts of a remote product that describe it; return the error where that fails."""
        odb = self.remote
        if odb is None:
            return self._missing(content.md5, content.where, [])
        path = odb.oid_to_path(content.md5)
        try:
            with odb.fs.open(path, "rb", block_size=descriptions.TAIL_BYTES, cache_type="none") as file:
                return descriptions.read(file, odb.fs.size(path), content.suffix, content.where)
        except ObjectFolderError as error:
            return error
        except FileNotFoundError:
            return self._missing(content.md5, content.where, [])
        except Exception as error:  # clouds have errors of their own making
            return self._missing(content.md5, content.where, [f"the remote: {type(error).__name__}: {error}"])

    def _cached_description(self, md5: str) -> Description | None:
        try:
            attributes, _, listing = zlib.decompress(self._cached.get(md5, b"")).partition(b"\0")
            return Description(json.loads(attributes), listing)
        except (sqlite3.Error, OSError, diskcache.Timeout, zlib.error, ValueError):
            return None

    @cached_property
    def _cached(self) -> diskcache.Cache:
        """A cache of descriptions of remote products, beside DVC's own state of this repository."""
        place = Path(self.repository.site_cache_dir) / "objectfolder-audit"
        try:
            return diskcache.Cache(str(place), size_limit=CACHED_BYTES, timeout=5)
        except (sqlite3.Error, OSError, diskcache.Timeout):  # damaged: losing it costs time only
            shutil.rmtree(place, ignore_errors=True)
            return diskcache.Cache(str(place), size_limit=CACHED_BYTES, timeout=5)
