"""What the audit reads of git: revisions, files of a revision, and the commits that touch a file."""

import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from objectfolder.errors import InputError

SEPARATOR = "\x1f"
_FORMAT = SEPARATOR.join(("%H", "%ct", "%s"))


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
    """The repository around a folder, read by git's own commands.

    Parameters
    ----------
    root
        Root of the data set; need not be the top of the work tree.

    Raises
    ------
    InputError
        `root` is in no repository, or git is not installed.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._prefix = self._run("rev-parse", "--show-prefix", finding="no git repository").strip()

    def commit(self, revision: str) -> Commit:
        """Return the commit that a revision names.

        Raises
        ------
        InputError
            No such revision.
        """
        # What begins with a dash would be an option, whatever git has of that name.
        name = "" if revision.startswith("-") else revision
        text = self._run(
            "log", "-1", f"--format={_FORMAT}", "--end-of-options", f"{name}^{{commit}}", "--",
            where=repr(revision), finding="no such revision in this repository",
            remedy="`git log --oneline` lists them; a shallow clone has few (`git fetch --unshallow`).",
        )  # fmt: skip
        return _commits(text)[0]

    def commits_of(self, path: str, revision: str = "HEAD") -> list[Commit]:
        """Return the commits behind `revision` that changed a file, newest first.

        Of a merge, only the first parent is followed: side by side, branches are no order of versions.

        Raises
        ------
        InputError
            No such revision.
        """
        start = self.commit(revision)
        return _commits(self._run("log", "--first-parent", f"--format={_FORMAT}", start.hash, "--", path))

    def read(self, revision: str, path: str) -> bytes | None:
        """Return a file of a revision, None where it has none."""
        return self.read_many([(revision, path)])[revision, path]

    def read_many(self, wanted: Iterable[tuple[str, str]]) -> Mapping[tuple[str, str], bytes | None]:
        """Return files by commit hash and path, None for those that are not there; one process for all.

        Raises
        ------
        InputError
            A path that git cannot be asked for, because it has a line break, or git fails.
        """
        asked = list(dict.fromkeys(wanted))
        for _, path in asked:
            if "\n" in self._prefix + path:
                raise InputError(repr(self._prefix + path), "has a line break", "Give it another name.")
        lines = "".join(f"{revision}:{self._prefix}{path}\n" for revision, path in asked)
        done = subprocess.run(
            ["git", "cat-file", "--batch"],
            cwd=self.root, input=lines.encode(), capture_output=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise InputError(
                str(self.root), f"git cannot read it ({done.stderr.decode(errors='replace').strip()})"
            )
        found: dict[tuple[str, str], bytes | None] = {}
        position = 0
        for key in asked:
            end = done.stdout.index(b"\n", position)
            header, position = done.stdout[position:end], end + 1
            found[key] = None
            if header.endswith(b" missing"):
                continue
            _, kind, count = header.split(b" ")
            size = int(count)
            if kind == b"blob":  # and no folder of this name
                found[key] = done.stdout[position : position + size]
            position += size + 1
        return found

    def _run(self, *arguments: str, finding: str = "", where: str = "", remedy: str = "") -> str:
        try:
            done = subprocess.run(["git", *arguments], cwd=self.root, capture_output=True, check=False)
        except FileNotFoundError as error:
            raise InputError("git", "is not installed", "Install git.") from error
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip().partition("\n")[0]
            raise InputError(where or str(self.root), finding or said, remedy or "See `git status`.")
        return done.stdout.decode(errors="replace")


def _commits(text: str) -> list[Commit]:
    found = []
    for line in text.splitlines():
        parts = line.split(SEPARATOR, 2)
        if len(parts) == 3:
            found.append(Commit(parts[0], int(parts[1]), parts[2]))
    return found
