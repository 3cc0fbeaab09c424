"""The files that git tracks, read from its index: git would run the monitor that a repository names."""

from pathlib import Path

import pygit2

from objectfolder.errors import InputError


def tracked_files(root: Path) -> set[Path]:
    """Return the files at or below a folder that git tracks; none where this is no work tree.

    Raises
    ------
    InputError
        A repository that cannot be read, or one of another user.
    """
    place = pygit2.discover_repository(str(root))
    if place is None:
        return set()
    try:
        repository = pygit2.Repository(place)
        if repository.workdir is None:
            return set()
        below = root.resolve().relative_to(Path(repository.workdir).resolve())
        paths = [Path(entry.path) for entry in repository.index]
    except (pygit2.GitError, OSError) as error:
        raise InputError(str(root), f"git's index cannot be read ({error})", "See `git status`.") from error
    return {root / path.relative_to(below) for path in paths if path.is_relative_to(below)}
