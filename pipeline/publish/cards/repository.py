"""A published data set: which products a revision has, and where their bytes are.

DVC opens the repository (a path, or a URL whose git history is cloned to a temporary folder), finds its
revision, its outputs, and its remote with its credentials. No product is read here but the lists of folders.
"""

import contextlib
import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from pipeline.dataset.products import ProductKind
from pipeline.dataset.records import SAFE_ID
from pipeline.dataset.stages import FIDELITY, MODES, OBJECT_FILES, OBJECTS, TOUCHES, VIEWS

KINDS = {kind.name: kind for kind in (OBJECT_FILES, OBJECTS, VIEWS, MODES, TOUCHES, FIDELITY)}
MD5 = re.compile(r"[0-9a-f]{32}")
LARGEST_LIST_BYTES = 100_000_000  # a million products; a list of strangers must not fill the memory
SCP_FORM = re.compile(r"[^/@]+@[^/:]+:")


def split_revision(repository: str) -> tuple[str, str | None]:
    """Split ``REPO@REV``; an address with a user name, as ``git@host:repo.git``, has no revision in it."""
    before, at, after = repository.rpartition("@")
    if not at or not after or Path(repository).exists():
        return repository, None
    address = re.match(r"[a-z+]+://[^/]*/.", before) or SCP_FORM.match(before)
    if address or ("://" not in repository and ":" not in after):
        return before, after
    return repository, None


class Stores:
    """The cache and the remote of a repository: content by MD5.

    Parameters
    ----------
    repository
        An open `dvc.repo.Repo`.
    remote
        Name of its remote; None takes the default one.
    """

    def __init__(self, repository: Any, remote: str | None) -> None:
        self._repository = repository
        self._remote_name = remote
        # A clone has no cache of its own, but perhaps one that others share.
        local = repository.cache.local
        self.sources: list[tuple[str, Any]] = [("its cache", local)] if local is not None else []
        self.no_remote = ""
        self._add_remote()

    def _add_remote(self) -> None:
        from dvc.config import ConfigError, NoRemoteError, RemoteConfigError
        from dvc.exceptions import DvcException

        try:
            odb = self._repository.cloud.get_remote_odb(self._remote_name)
        except (NoRemoteError, RemoteConfigError, ConfigError) as error:
            if self._remote_name:
                known = ", ".join(sorted(self._repository.config["remote"])) or "none"
                raise InputError(
                    self._remote_name, "the repository has no such remote", f"It has {known}."
                ) from error
            self.no_remote = "it has no default DVC remote"
        except DvcException as error:
            self.no_remote = f"its remote cannot be used ({error})"
        else:
            self.sources.append((f"its remote {odb.path}", odb))

    def missing(self, where: str, md5: str) -> InputError:
        """Return the error to raise for content that no store has."""
        searched = " and ".join(name for name, _ in self.sources) or "any cache"
        finding = f"content {md5} is missing in {searched}" + (self.no_remote and f", and {self.no_remote}")
        return InputError(where, finding, "Ask its publisher to `dvc push` this revision.")

    def read(self, where: str, md5: str, suffix: str = "") -> bytes:
        """Return small content, checked, from the first store that has it whole.

        Raises
        ------
        InputError
            No store has it, or those that may have it cannot be read or have something else.
        """
        errors: list[str] = []
        for name, odb in self.sources:
            try:
                with odb.fs.open(odb.oid_to_path(md5 + suffix), mode="rb") as file:
                    content: bytes = file.read(LARGEST_LIST_BYTES + 1)
            except FileNotFoundError:
                continue
            except Exception as error:  # each kind of store has its own
                errors.append(f"{name}: {type(error).__name__}: {error}".strip().replace("\n", " "))
                continue
            if len(content) > LARGEST_LIST_BYTES:
                errors.append(f"{name}: more than {LARGEST_LIST_BYTES} bytes")
            elif hashlib.md5(content, usedforsecurity=False).hexdigest() != md5:
                errors.append(f"{name}: what is stored as {md5} is damaged")
            else:
                return content
        if errors:
            remedy = "Check network and credentials, then ask its publisher."
            raise InputError(where, f"cannot be read ({'; '.join(errors)})", remedy)
        raise self.missing(where, md5)


class PublishedRevision:
    """One revision of a published data set."""

    def __init__(self, name: str, repository: Any, remote: str | None) -> None:
        self.name = name
        self._repository = repository
        self.stores = Stores(repository, remote)

    def products(self, kind: ProductKind) -> dict[str, str]:
        """Return the MD5 of each product of a kind, by object id.

        Raises
        ------
        InputError
            A revision without this kind of product, or whose list no store gives.
        FormatError
            A list that is none.
        """
        out = self._out(kind.folder)
        digest = out.hash_info.value if out is not None and out.hash_info else None
        if not digest or not digest.endswith(".dir"):
            raise InputError(
                self.name,
                f"this revision has no {kind.folder}",
                "Give a revision that has the data set made and committed.",
            )
        where = f"{self.name}, {kind.folder}"
        content = self.stores.read(where, digest.removesuffix(".dir"), ".dir")
        try:
            entries = {str(entry["relpath"]): str(entry["md5"]) for entry in json.loads(content)}
        except (ValueError, KeyError, TypeError) as error:
            raise FormatError(
                where, f"its list of files is damaged ({error})", "Ask its publisher."
            ) from error
        return _safe(entries, kind.suffix)

    def _out(self, folder: str) -> Any:
        from dvc.exceptions import DvcException

        try:
            outs = self._repository.index.outs
        except DvcException as error:
            raise InputError(
                self.name, f"its stages cannot be read ({error})", "Ask its publisher."
            ) from error
        root = self._repository.root_dir
        fs = self._repository.fs
        return next((out for out in outs if fs.relpath(out.fs_path, root).replace("\\", "/") == folder), None)


def _safe(entries: Mapping[str, str], suffix: str) -> dict[str, str]:
    """Return what can be a product: a list of strangers must not lead out of a folder."""
    found = {}
    for name, md5 in entries.items():
        object_id = name.removesuffix(suffix)
        if name.endswith(suffix) and SAFE_ID.fullmatch(object_id) and MD5.fullmatch(md5):
            found[object_id] = md5
    return found


@contextlib.contextmanager
def opened(
    repository: str, revision: str | None = None, remote: str | None = None
) -> Iterator[PublishedRevision]:
    """Open a revision of a repository under DVC; a temporary clone is gone afterwards.

    Parameters
    ----------
    repository
        A path, or what ``git clone`` takes.
    revision
        Branch, tag or commit; None is what lies in a path, and the default branch of a URL.
    remote
        Name of the DVC remote; None takes the default one.

    Raises
    ------
    InputError
        No repository there, none under DVC, or no such revision or remote.
    """
    from dvc.exceptions import DvcException, NotDvcRepoError
    from dvc.repo import Repo
    from dvc.repo.open_repo import clean_repos
    from dvc.scm import CloneError, RevError, SCMError

    name = f"{repository}@{revision}" if revision else repository
    try:
        made = Repo.open(repository, rev=revision, uninitialized=False)
    except RevError as error:
        raise InputError(
            repository, f"no revision {revision!r}", "Name a branch, tag or commit of it."
        ) from error
    except CloneError as error:
        raise InputError(
            repository, f"cannot be cloned ({_cause(error)})", "Check the path or URL."
        ) from error
    except NotDvcRepoError as error:
        raise InputError(repository, "a repository, but not under DVC", "Name that of a data set.") from error
    except (DvcException, SCMError) as error:
        raise InputError(name, f"cannot be opened ({_cause(error)})", "Check path and revision.") from error
    try:
        yield PublishedRevision(name, made, remote)
    finally:
        made.close()
        clean_repos()


def _cause(error: BaseException) -> str:
    return str(error.__cause__ or error).strip().replace("\n", " ")
