"""What the audit reads of git: revisions, files of a revision, and the commits that changed a file."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import pygit2

from objectfolder.errors import InputError


@dataclass(frozen=True)
class Commit:
    """A commit: its full hash, time (seconds since 1970), and first line of the message as it was written."""

    hash: str
    time: int
    subject: str

    @property
    def short(self) -> str:
        """First digits of the hash."""
        return self.hash[:9]

    @property
    def day(self) -> str:
        """Day at which it was made, in UTC."""
        return datetime.fromtimestamp(self.time, UTC).strftime("%Y-%m-%d")


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
        """Return the commit that a revision names; raise InputError for no such revision."""
        return _commit(self._resolved(revision))

    def commits_of(self, paths: Sequence[str], revision: str = "HEAD") -> list[Commit]:
        """Return the commits behind `revision` that changed any of some files, newest first.

        Of a merge, only the first parent is followed: side by side, branches are no order of versions.

        Raises
        ------
        InputError
            No such revision.
        """
        walk = self._repository.walk(self._resolved(revision).id)
        walk.simplify_first_parent()
        commits = list(walk)
        files = [[self._blob(commit, path) for path in paths] for commit in commits]
        digests = [[blob and blob.id for blob in blobs] for blobs in files]
        changes = zip(commits, pairwise([*digests, [None] * len(paths)]), strict=True)
        return [_commit(commit) for commit, (after, before) in changes if after != before]

    def read(self, revision: str, path: str) -> bytes | None:
        """Return a file of a revision, None where it has none; raise InputError for no such revision."""
        blob = self._blob(self._resolved(revision), path)
        return None if blob is None else blob.data

    def names(self, revision: str, folder: str) -> list[str]:
        """Return what lies in a folder of a revision; nothing where it has none.

        Raises
        ------
        InputError
            No such revision.
        """
        try:
            tree = self._resolved(revision).tree[(self._prefix / folder).as_posix()]
        except KeyError:
            return []
        return [str(entry.name) for entry in tree] if isinstance(tree, pygit2.Tree) else []

    def _resolved(self, revision: str) -> pygit2.Commit:
        try:
            return self._repository.revparse_single(revision).peel(pygit2.Commit)
        except (KeyError, ValueError, pygit2.GitError) as error:
            remedy = "`git log --oneline` lists them; a shallow clone has few (`git fetch --unshallow`)."
            raise InputError(repr(revision), "no such revision in this repository", remedy) from error

    def _blob(self, commit: pygit2.Commit, path: str) -> pygit2.Blob | None:
        try:
            entry = commit.tree[(self._prefix / path).as_posix()]
        except (KeyError, ValueError):
            return None
        return entry if isinstance(entry, pygit2.Blob) else None


def _commit(commit: pygit2.Commit) -> Commit:
    return Commit(str(commit.id), commit.commit_time, commit.message.partition("\n")[0])
