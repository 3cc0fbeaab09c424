"""What the audit reads of git: revisions, files of a revision, and the commits that changed a file."""

from dataclasses import dataclass
from pathlib import Path

import pygit2

from objectfolder.errors import InputError


@dataclass(frozen=True)
class Commit:
    """A commit.

    Parameters
    ----------
    hash
        In full.
    time
        Seconds since 1970 at which it was made.
    subject
        First line of its message, as written by whoever made it.
    """

    hash: str
    time: int
    subject: str

    @property
    def short(self) -> str:
        """First digits of the hash."""
        return self.hash[:9]


class GitRepository:
    """The repository around a folder.

    Parameters
    ----------
    root
        Root of the data set; need not be the top of the work tree.

    Raises
    ------
    InputError
        `root` is in no repository.
    """

    def __init__(self, root: Path) -> None:
        place = pygit2.discover_repository(str(root))
        if place is None:
            raise InputError(str(root), "no git repository", "Go to the root of a data set.")
        self._repository = pygit2.Repository(place)
        top = Path(self._repository.workdir or root).resolve()
        self._prefix = root.resolve().relative_to(top)

    def commit(self, revision: str) -> Commit:
        """Return the commit that a revision names.

        Raises
        ------
        InputError
            No such revision.
        """
        try:
            return _commit(self._repository.revparse_single(revision).peel(pygit2.Commit))
        except (KeyError, ValueError, pygit2.GitError) as error:
            remedy = "`git log --oneline` lists them; a shallow clone has few (`git fetch --unshallow`)."
            raise InputError(repr(revision), "no such revision in this repository", remedy) from error

    def commits_of(self, path: str, revision: str = "HEAD") -> list[Commit]:
        """Return the commits behind `revision` that changed a file, newest first.

        Of a merge, only the first parent is followed: side by side, branches are no order of versions.

        Raises
        ------
        InputError
            No such revision.
        """
        walk = self._repository.walk(self.commit(revision).hash)
        walk.simplify_first_parent()
        found: list[Commit] = []
        later: tuple[pygit2.Commit, pygit2.Oid | None] | None = None
        for commit in walk:
            content = self._blob_id(commit, path)
            if later is not None and later[1] != content:
                found.append(_commit(later[0]))
            later = commit, content
        if later is not None and later[1] is not None:
            found.append(_commit(later[0]))
        return found

    def read(self, revision: str, path: str) -> bytes | None:
        """Return a file of a revision, None where it has none.

        Raises
        ------
        InputError
            No such revision.
        """
        blob = self._blob_id(self._repository[self.commit(revision).hash].peel(pygit2.Commit), path)
        return None if blob is None else self._repository[blob].peel(pygit2.Blob).data

    def _blob_id(self, commit: pygit2.Commit, path: str) -> pygit2.Oid | None:
        try:
            found = commit.tree[(self._prefix / path).as_posix()]
        except (KeyError, ValueError):
            return None
        return found.id if isinstance(found, pygit2.Blob) else None


def _commit(found: pygit2.Commit) -> Commit:
    return Commit(str(found.id), found.commit_time, found.message.partition("\n")[0])
