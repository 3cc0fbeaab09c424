"""The half of the tests that protects a release: ``@pytest.mark.release("objectfolder.audio", ...)``.

The mark names the packages that a test is about, as dotted names of folders. Such a test runs with
``pytest --release all``, or with ``--release objectfolder.audio,pipeline`` where one of its packages is
named, lies in a named one, or holds one. ``--release changed`` names what git says has changed since the
commit of ``released_commit``, at which all tests passed.
"""

import fnmatch
import subprocess
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

import pytest

REPOSITORY = Path(__file__).parents[1]
RELEASED = Path(__file__).with_name("released_commit")
# No test is about these. `released_commit` itself changes after the commit that it names.
WITHOUT_CODE = ("*.md", "LICENSE", "CITATION.cff", "dvc.lock", "tests/released_commit")


def overlap(first: str, second: str) -> bool:
    """Whether one is the other or holds it; the empty name is the repository, which holds all."""
    short, long = sorted((first, second), key=len)
    return not short or f"{long}.".startswith(f"{short}.")


def packages_of_files(files: Iterable[str]) -> set[str]:
    """Return the packages that files lie in.

    A module of tests counts for itself alone. A file of the root, such as a lock or ``pyproject.toml``, and
    what all tests share, such as ``tests/conftest.py``, counts for all tests: it can change any of them.
    """
    packages = set()
    for path in files:
        if not any(fnmatch.fnmatch(path, pattern) for pattern in WITHOUT_CODE):
            module = PurePosixPath(path)
            alone = path.startswith("tests/") and module.name.startswith("test_")
            packages.add(".".join((module.with_suffix("") if alone else module.parent).parts))
    return packages


def changed_files(since: str, repository: Path) -> list[str] | None:
    """Return the tracked files that differ from a commit; None where git does not know the commit."""
    command = ["git", "-c", "core.quotePath=false", "diff", "--name-only", "--no-renames", since, "--"]
    try:
        answer = subprocess.run(command, cwd=repository, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return answer.stdout.splitlines()


def chosen_packages(option: str, repository: Path = REPOSITORY, released: Path = RELEASED) -> set[str]:
    """Return the packages whose release tests run: those of ``--release``, the empty name for all."""
    if option == "changed":
        files = changed_files(released.read_text().strip(), repository)
        return {""} if files is None else packages_of_files(files)
    names = set(option.split(",")) - {""}
    unknown = sorted(name for name in names - {"all"} if not is_package(name))
    if unknown:
        raise pytest.UsageError(f"--release {option}: no package {', '.join(unknown)}; name folders as a.b")
    return {""} if "all" in names else names


def is_package(name: str) -> bool:
    """Whether a dotted name is that of a folder of the repository."""
    words = name.split(".")
    return all(word.isidentifier() for word in words) and REPOSITORY.joinpath(*words).is_dir()


class ReleaseHalf:
    """Leaves out the release tests of packages that are not chosen."""

    def __init__(self, chosen: set[str]) -> None:
        self.chosen = chosen
        self.marks: dict[str, tuple[object, ...]] = {}  # of all release tests, by name

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        runs, waits = [], []
        for item in items:
            packages = [name for mark in item.iter_markers("release") for name in mark.args]
            if item.get_closest_marker("release"):
                self.marks[item.nodeid] = tuple(packages)
                # A change of the test or of what its folder shares counts, too.
                packages.append(item.nodeid.partition("::")[0].removesuffix(".py").replace("/", "."))
                is_chosen = any(overlap(name, package) for name in packages for package in self.chosen)
                (runs if is_chosen else waits).append(item)
            else:
                runs.append(item)
        if waits:
            config.hook.pytest_deselected(items=waits)
            items[:] = runs


def register(config: pytest.Config, option: str) -> ReleaseHalf:
    """Choose the release tests of this run."""
    half = ReleaseHalf(chosen_packages(option))
    config.pluginmanager.register(half)
    return half
