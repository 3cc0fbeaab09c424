"""Files of any version by the hash of their content: in DVC's cache, or at its remote, read in parts."""

import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.audit import descriptions
from pipeline.audit.attribute_cache import AttributeCache
from pipeline.audit.descriptions import Description
from pipeline.audit.lock_file import read_folder

AT_ONCE = 16  # requests to a remote
BLOCK_BYTES = descriptions.TAIL_BYTES
FETCH = "Fetch it: `dvc fetch --all-commits`, or name the remote that has it with --remote."


class NotHere(ObjectFolderError):
    """A content that is neither in the cache nor at the remote."""


@dataclass(frozen=True)
class Content:
    """A content and what kind of product it is, its hash and where it lies if not in the cache.

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


class Contents:
    """The cache of a data set, and its remote where that is not enough.

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
        self._remote_name = remote
        try:
            self._repository = Repo(str(root))
        except (DvcException, OSError) as error:
            raise InputError(
                str(root), f"not under DVC ({error})", "Go to the root of a data set."
            ) from error
        if Path(self._repository.root_dir) != root:
            remedy = f"Go to {self._repository.root_dir}."
            raise InputError(str(root), "not the root of the data set, but a folder in it", remedy)
        # As texts: versions of a thousand objects ask for fourteen thousand files.
        self._folders = (str(self._repository.cache.local.path), str(self._repository.cache.legacy.path))
        self._remote: Any = None
        self._no_remote = ""
        self.fetched_bytes = 0
        self._cache: AttributeCache | None = None

    def __enter__(self) -> "Contents":
        return self

    def __exit__(self, *_: object) -> None:
        if self._cache is not None:
            self._cache.__exit__(None, None, None)
        self._repository.close()

    @property
    def state(self) -> Any:
        """What DVC knows of files of the work tree by size, time and inode."""
        return self._repository.state

    def path(self, md5: str) -> Path | None:
        """Return the file of the cache that should have this content."""
        found = self._near(md5)
        return Path(found) if found is not None else None

    def size(self, content: Content) -> int | None:
        """Return the bytes of a content at hand, None where it is not."""
        path = content.path or self._near(content.md5)
        try:
            return os.stat(path).st_size if path is not None else None
        except OSError:
            return None

    def folder(self, md5: str, where: str) -> dict[str, str]:
        """Return the files of a folder, path inside it to MD5.

        Raises
        ------
        NotHere
            Its list is neither in the cache nor at the remote.
        FormatError
            A damaged one.
        """
        path = self.path(md5)
        if path is not None:
            text = path.read_bytes()
        else:
            with self._far(md5, where) as (file, size):
                text = file.read()
                self.fetched_bytes += size
        return read_folder(where, text)

    def describe(self, content: Content) -> Description:
        """Return what a product says of itself.

        Raises
        ------
        NotHere
            It is neither in the cache nor at the remote.
        FormatError
            A damaged one.
        """
        path = content.path or self._near(content.md5)
        if path is not None:
            try:
                with open(path, "rb", buffering=0) as near:
                    size = os.fstat(near.fileno()).st_size
                    return descriptions.read(cast(BinaryIO, near), size, content.suffix, content.where)
            except FileNotFoundError:
                pass  # removed just now
            except OSError as error:
                raise NotHere(content.where, f"cannot be read ({error.strerror})", FETCH) from error
        cache = self._attributes()
        known = cache.get(content.md5)
        if known is None:
            known = self._describe_far(content)
            cache.put(content.md5, known)
        return known

    def describe_all(self, wanted: Sequence[Content]) -> Mapping[str, Description | ObjectFolderError]:
        """Return descriptions, or why there is none, of contents that are far; by MD5, many at once."""
        cache = self._attributes()
        found: dict[str, Description | ObjectFolderError] = {}
        missing = []
        for content in {one.md5: one for one in wanted}.values():
            known = cache.get(content.md5)
            if known is None:
                missing.append(content)
            else:
                found[content.md5] = known
        if missing and self._odb() is not None:
            with ThreadPoolExecutor(AT_ONCE) as pool:
                for content, one in zip(missing, pool.map(self._tried, missing), strict=True):
                    found[content.md5] = one
                    if isinstance(one, Description):
                        cache.put(content.md5, one)
        return found

    def is_near(self, content: Content) -> bool:
        """Whether a content is at hand, without a remote."""
        return content.path is not None or self._near(content.md5) is not None

    def sizes_far(self, wanted: Iterable[str]) -> Mapping[str, int]:
        """Return the bytes of contents as the remote has them, those it has."""
        names = list(wanted)
        if not names or self._odb() is None:
            return {}

        def size(md5: str) -> int | None:
            try:
                found = self._remote.fs.size(self._remote.oid_to_path(md5))
            except Exception:  # a cloud's own errors: what is not known is not counted
                return None
            return int(found) if found is not None else None

        with ThreadPoolExecutor(AT_ONCE) as pool:
            known = zip(names, pool.map(size, names), strict=True)
            return {md5: found for md5, found in known if found is not None}

    def fetch(self, md5: str, target: Path, where: str) -> None:
        """Copy a whole content from the remote.

        Raises
        ------
        NotHere
            The remote has none.
        """
        with self._far(md5, where) as (file, size), target.open("wb") as copy:
            while block := file.read(1 << 20):
                copy.write(block)
            self.fetched_bytes += size

    def _near(self, md5: str) -> str | None:
        for folder in self._folders:
            found = f"{folder}{os.sep}{md5[:2]}{os.sep}{md5[2:]}"
            if os.path.isfile(found):
                return found
        return None

    def _tried(self, content: Content) -> Description | ObjectFolderError:
        try:
            return self._describe_far(content)
        except ObjectFolderError as error:
            return error

    def _describe_far(self, content: Content) -> Description:
        with self._far(content.md5, content.where) as (file, size):
            counted = _Counted(file)
            try:
                return descriptions.read(cast(BinaryIO, counted), size, content.suffix, content.where)
            finally:
                self.fetched_bytes += counted.bytes

    @contextlib.contextmanager
    def _far(self, md5: str, where: str) -> Iterator[tuple[BinaryIO, int]]:
        """Open a content at the remote; only what is read of it is fetched."""
        odb = self._odb()
        if odb is None:
            raise NotHere(where, f"not readable here: not in the cache, and {self._no_remote}", FETCH)
        path = odb.oid_to_path(md5)
        try:
            with odb.fs.open(path, "rb", block_size=BLOCK_BYTES, cache_type="none") as file:
                yield file, odb.fs.size(path)
        except ObjectFolderError:
            raise
        except FileNotFoundError as error:
            finding = "not readable here: neither in the cache nor at the remote"
            raise NotHere(where, finding, FETCH) from error
        except Exception as error:  # clouds have errors of their own making
            finding = f"not readable here: the remote answers {type(error).__name__}: {error}"
            raise NotHere(where, finding, "See that the remote can be reached: `dvc status -c`.") from error

    def _odb(self) -> Any:
        from dvc.config import NoRemoteError

        if self._remote is None and not self._no_remote:
            try:
                self._remote = self._repository.cloud.get_remote_odb(self._remote_name or None)
            except Exception as error:  # none is set, or its settings or its library are missing
                said = str(error).partition("\n")[0].rstrip(".")
                self._no_remote = "no remote is set" if isinstance(error, NoRemoteError) else said
                if self._remote_name:
                    raise InputError(
                        self._remote_name, f"no such remote ({error})", "`dvc remote list` names them."
                    ) from error
        return self._remote

    def _attributes(self) -> AttributeCache:
        if self._cache is None:
            self._cache = AttributeCache(self.root)
        return self._cache


class _Counted:
    """A file that counts what is read of it."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.bytes = 0

    def seek(self, position: int, whence: int = 0) -> int:
        return self._file.seek(position, whence)

    def tell(self) -> int:
        return self._file.tell()

    def seekable(self) -> bool:
        return True

    def read(self, count: int = -1) -> bytes:
        data = self._file.read(count)
        self.bytes += len(data)
        return data
