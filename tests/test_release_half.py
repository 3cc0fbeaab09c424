"""Which tests wait for a release, and which changes make them run."""

import subprocess
from pathlib import Path

import pytest

from tests import release_half
from tests.release_half import changed_files, chosen_packages, overlap, packages_of_files

pytest_plugins = ["pytester"]

TESTS = """
import pytest

@pytest.mark.release("objectfolder.audio", "learning")
def test_finest():
    pass

def test_small():
    pass
"""


def test_marks_name_packages(release_marks: dict[str, tuple[object, ...]]) -> None:
    for test, packages in release_marks.items():
        assert packages, f"{test}: name the packages whose change makes it run"
        unknown = [name for name in packages if not release_half.is_package(str(name))]
        assert not unknown, f"{test}: no folder of the repository is {unknown}"


@pytest.mark.parametrize(
    ("option", "count"),
    [("", 1), ("all", 2), ("pipeline,objectfolder.audio.air", 2), ("objectfolder", 2), ("pipeline", 1)],
)
def test_release_tests_run_where_they_are_chosen(
    option: str, count: int, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # their start would take most of the time
    pytester.makeconftest(
        "from tests import release_half\n"
        f"def pytest_configure(config): release_half.register(config, {option!r})"
    )
    pytester.makepyfile(TESTS)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-W", "ignore")
    result.assert_outcomes(passed=count, deselected=2 - count)


@pytest.mark.parametrize("option", ["nowhere", "objectfolder.", "objectfolder,objectfolder/audio"])
def test_a_package_that_is_none_is_an_error(option: str) -> None:
    with pytest.raises(pytest.UsageError, match="no package"):
        chosen_packages(option)


@pytest.mark.parametrize(
    ("file", "package", "counts"),
    [
        ("objectfolder/audio/air/transfer.py", "objectfolder.audio", True),
        ("objectfolder/errors.py", "objectfolder.audio", True),
        ("objectfolder/audiofile/a.py", "objectfolder.audio", False),
        ("tests/audio/closed_form.py", "tests.audio.test_modes", True),
        ("tests/audio/test_eigen.py", "tests.audio.test_modes", False),
        ("tests/audio/test_modes.py", "tests.audio.test_modes", True),
        ("tests/conftest.py", "tests.audio.test_modes", True),
        ("requirements-test.lock", "learning", True),
        ("pyproject.toml", "cluster", True),
        ("objectfolder/audio/notes.md", "objectfolder.audio", False),
        ("tests/released_commit", "tests.audio.test_modes", False),
    ],
)
def test_a_changed_file_counts_for_its_package(file: str, package: str, counts: bool) -> None:
    assert any(overlap(package, changed_package) for changed_package in packages_of_files([file])) == counts


def test_changed_packages_are_those_since_the_commit(tmp_path: Path) -> None:
    repository, released = tmp_path / "repository", tmp_path / "released"

    def git(*words: str) -> str:
        identity = ("-c", "user.name=a", "-c", "user.email=a@b")
        done = subprocess.run(
            ["git", *identity, *words], cwd=repository, check=True, capture_output=True, text=True
        )
        return done.stdout.strip()

    repository.mkdir()
    released.write_text("none\n")
    assert chosen_packages("changed", repository, released) == {""}  # no repository of git
    git("init", "-q")
    for name in ("learning/a.py", "pipeline/run/ü b.py", "cluster/c.py"):
        (repository / name).parent.mkdir(parents=True, exist_ok=True)
        (repository / name).write_text(name)
    git("add", ".")
    git("commit", "-qm", "first")
    released.write_text(git("rev-parse", "HEAD") + "\n")
    git("mv", "pipeline/run/ü b.py", "pipeline/moved.py")
    git("commit", "-qm", "second")
    (repository / "cluster" / "c.py").write_text("edited")
    assert chosen_packages("changed", repository, released) == {"pipeline", "pipeline.run", "cluster"}
    assert changed_files("0" * 40, repository) is None
