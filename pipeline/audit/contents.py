"""Descriptions of the products of any version, read from the cache or, in parts, from the remote."""

import contextlib
import os
import shutil
import sqlite3
import zlib
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import diskcache

from objectfolder.errors import InputError, ObjectFolderError
from objectfolder.products.regular_file import open_regular
from pipeline.audit import descriptions
from pipeline.audit.descriptions import TAIL_BYTES, Description
from pipeline.audit.opening import opened_folder
from pipeline.audit.stores import FETCH, NotHere, Stores

AT_ONCE = 16  # requests to a remote
CACHED_BYTES = 256 << 20  # descriptions of about 100,000 products
DESCRIBED = 64  # local products in memory: those of the object that is looked at
_CACHE_ERRORS = (sqlite3.Error, OSError, LookupError, ValueError, zlib.error, diskcache.Timeout)


@dataclass(frozen=True)
class Content:
    """The content of a product, by the MD5 of its bytes.

    Parameters
    ----------
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
    folder
        Root of the data set, or a folder in it.
    remote
        Name of a remote of DVC; the default one where it is empty.

    Raises
    ------
    InputError
        `folder` is not under DVC, or its settings go beyond what is taken of them (`pipeline.audit.opening`).
    """

    def __init__(self, folder: Path, remote: str = "") -> None:
        from dvc.exceptions import DvcException

        self._opening = contextlib.ExitStack()
        try:
            repository = self._opening.enter_context(opened_folder(str(folder)))
        except (DvcException, OSError) as error:
            finding = f"not under DVC ({error})"
            raise InputError(str(folder), finding, "Go to the root of a data set.") from error
        self.root = Path(repository.root_dir)
        super().__init__(repository, remote)
        self._far: dict[str, Description | ObjectFolderError] = {}
        self._describe_near = lru_cache(DESCRIBED)(self._read_near)

    def __enter__(self) -> "Contents":
        return self

    def __exit__(self, *_: object) -> None:
        if "_cached" in self.__dict__:
            self._cached.close()
        self._opening.close()

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
        path = content.path or self.path(content.md5)
        try:
            return os.stat(path).st_size if path is not None else None
        except OSError:
            return None

    def sizes_far(self, digests: Iterable[str]) -> Mapping[str, int]:
        """Return the sizes in bytes of those contents that the remote has."""
        names = list(digests)
        if not names or self.remote is None:
            return {}

        def size(md5: str) -> int | None:
            try:
                byte_count = self.remote.fs.size(self.remote.oid_to_path(md5))
            except Exception:  # a cloud's own errors: contents of unknown size are left out
                return None
            return int(byte_count) if byte_count is not None else None

        with ThreadPoolExecutor(AT_ONCE) as pool:
            sizes = zip(names, pool.map(size, names), strict=True)
            return {md5: byte_count for md5, byte_count in sizes if byte_count is not None}

    def describe(self, content: Content) -> Description:
        """Return the description of a product.

        Raises
        ------
        NotHere
            It is neither in the cache nor at the remote.
        FormatError
            A damaged one.
        """
        near = self._describe_near(content)
        if near is not None:
            return near
        self.describe_all([content])
        far = self._far.get(content.md5) or self._describe_far(content)
        if isinstance(far, ObjectFolderError):
            raise far
        return far

    def describe_all(self, contents: Iterable[Content]) -> None:
        """Read the descriptions of many remote products in parallel; one by one would take minutes."""
        far = [content for content in contents if content.path is None and content.md5 not in self._far]
        missing = {content.md5: content for content in far if self.path(content.md5) is None}
        with contextlib.suppress(*_CACHE_ERRORS):
            for md5 in [md5 for md5 in missing if md5 in self._cached]:
                attributes, listing = self._cached[md5]
                self._far[md5] = Description(attributes, listing.encode("latin-1"))
                del missing[md5]
        if not missing:
            return
        assert self.remote is None or self.remote.fs  # opened once, before there are threads
        with ThreadPoolExecutor(AT_ONCE) as pool:
            for md5, outcome in zip(missing, pool.map(self._describe_far, missing.values()), strict=True):
                self._far[md5] = outcome
                if isinstance(outcome, Description):
                    with contextlib.suppress(*_CACHE_ERRORS):
                        self._cached[md5] = outcome.attributes, outcome.listing.decode("latin-1")

    def _read_near(self, content: Content) -> Description | None:
        path = content.path or self.path(content.md5)
        if path is None:
            return None
        try:
            with open_regular(path) as near:
                return descriptions.read(near, content.suffix, content.where)
        except FileNotFoundError:
            return None  # removed just now
        except OSError as error:
            raise NotHere(content.where, f"cannot be read ({error.strerror})", FETCH) from error

    def _describe_far(self, content: Content) -> Description | ObjectFolderError:
        """Read the parts of a remote product that describe it; return the error where that fails."""
        problems = []
        try:
            if self.remote is not None:
                path = self.remote.oid_to_path(content.md5)
                with self.remote.fs.open(path, "rb", block_size=TAIL_BYTES) as file:
                    return descriptions.read(file, content.suffix, content.where)
        except ObjectFolderError as error:
            return error
        except FileNotFoundError:
            pass
        except Exception as error:  # clouds have errors of their own making
            problems = [f"the remote: {type(error).__name__}: {error}"]
        return self._missing(content.md5, content.where, problems)

    @cached_property
    def _cached(self) -> diskcache.Cache:
        """A cache of descriptions of remote products, beside DVC's own state of this repository."""
        place = Path(self.repository.site_cache_dir) / "objectfolder-audit"
        settings = {"size_limit": CACHED_BYTES, "timeout": 5, "disk": diskcache.JSONDisk}
        try:
            return diskcache.Cache(str(place), **settings)
        except _CACHE_ERRORS:  # damaged: losing it costs time only
            shutil.rmtree(place, ignore_errors=True)
            return diskcache.Cache(str(place), **settings)
