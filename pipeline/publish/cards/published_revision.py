"""A published data set: which products a revision has, and where their bytes are.

DVC opens the repository (a path, or a URL whose git history is cloned to a temporary folder), finds its
revision, its outputs, and its remote with its credentials.
"""

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from pipeline.audit.stores import Stores
from pipeline.dataset.products import ProductKind
from pipeline.dataset.records import SAFE_ID

SCP_FORM = re.compile(r"[^/@]+@[^/:]+:")
NOT_PUSHED = "Ask its publisher to `dvc push` this revision."


def split_revision(repository: str) -> tuple[str, str | None]:
    """Split ``REPO@REV``; an address with a user name, as ``git@host:repo.git``, has no revision in it."""
    before, at, after = repository.rpartition("@")
    if not at or not after or Path(repository).exists():
        return repository, None
    address = re.match(r"[a-z+]+://[^/]*/.", before) or SCP_FORM.match(before)
    if address or ("://" not in repository and ":" not in after):
        return before, after
    return repository, None


class PublishedRevision:
    """One revision of a published data set.

    Parameters
    ----------
    name
        For messages.
    repository
        An open `dvc.repo.Repo`.
    remote
        Name of its remote; the default one where it is empty.

    Raises
    ------
    InputError
        No such remote.
    """

    def __init__(self, name: str, repository: Any, remote: str) -> None:
        self.name = name
        self._repository = repository
        self.stores = Stores(repository, remote, NOT_PUSHED)
        _ = self.stores.remote

    def products(self, kind: ProductKind) -> dict[str, str]:
        """Return the MD5 of each product of a kind, by object id.

        Raises
        ------
        InputError
            A revision without this kind of product.
        NotHere
            No store gives the list of them.
        FormatError
            A list that is none.
        """
        out = self._out(kind.folder)
        digest = out.hash_info.value if out is not None and out.hash_info else None
        if not digest or not digest.endswith(".dir"):
            remedy = "Give a revision that has the data set made and committed."
            raise InputError(self.name, f"this revision has no {kind.folder}", remedy)
        files = self.stores.folder(digest, f"{self.name}, {kind.folder}")
        # The list is not trusted: a name in it must not lead out of a folder.
        names = {
            name.removesuffix(kind.suffix): md5 for name, md5 in files.items() if name.endswith(kind.suffix)
        }
        return {object_id: md5 for object_id, md5 in names.items() if SAFE_ID.fullmatch(object_id)}

    def _out(self, folder: str) -> Any:
        from dvc.exceptions import DvcException

        try:
            outs = self._repository.index.outs
        except DvcException as error:
            raise InputError(
                self.name, f"its stages cannot be read ({error})", "Ask its publisher."
            ) from error
        root, fs = self._repository.root_dir, self._repository.fs
        return next((out for out in outs if fs.relpath(out.fs_path, root).replace("\\", "/") == folder), None)


@contextlib.contextmanager
def opened(repository: str, revision: str | None = None, remote: str = "") -> Iterator[PublishedRevision]:
    """Open a revision of a repository under DVC; a temporary clone is removed afterwards.

    Parameters
    ----------
    repository
        A path, or what ``git clone`` takes.
    revision
        Branch, tag or commit; None is what lies in a path, and the default branch of a URL.
    remote
        Name of the DVC remote; the default one where it is empty.

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
        remedy = "Name a branch, tag or commit of it."
        raise InputError(repository, f"no revision {revision!r}", remedy) from error
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
