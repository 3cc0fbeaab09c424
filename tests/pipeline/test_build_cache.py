"""What an interrupted build leaves, and for how long."""

import os
from contextlib import suppress
from pathlib import Path

import pytest

from objectfolder.errors import InputError
from pipeline.dataset.job import Finished, Job
from pipeline.dataset.task import Call, Failure, Outcome, Request
from pipeline.run.build_cache import unfinished_build
from pipeline.run.single_build import Building, UntilFailure, build_object_file


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "objectfolder" / "builds"


def interrupt(output: str, content: bytes = b"views") -> Path:
    with suppress(KeyboardInterrupt), unfinished_build(Path("mug.obj"), Path(output)) as folder:
        folder.mkdir(exist_ok=True)
        (folder / "views").write_bytes(content)
        raise KeyboardInterrupt
    return folder


def test_a_cache_folder_that_cannot_be_written_is_named_with_the_remedy(cache: Path) -> None:
    cache.parents[1].touch()
    with pytest.raises(InputError, match=r"builds: .*Set XDG_CACHE_HOME .* or give --keep"):
        interrupt("mug.safetensors")


def test_a_place_that_cannot_be_written_is_said_before_anything_is_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "box.stl").touch()
    building = Building(mesh=tmp_path / "box.stl", material="steel")
    with pytest.raises(InputError, match=r"cannot be written in .*file\. Name another folder"):
        build_object_file(building, tmp_path / "file" / "new" / "box.safetensors")


def test_the_same_command_resumes_and_a_build_that_succeeds_leaves_nothing() -> None:
    folder = interrupt("mug.safetensors")
    with unfinished_build(Path("mug.obj"), Path("other.safetensors")) as other_folder:
        other_folder.mkdir()
    with unfinished_build(Path("mug.obj").absolute(), Path("mug.safetensors")) as resumed:
        assert (resumed / "views").read_bytes() == b"views"
    assert resumed == folder != other_folder
    assert not folder.exists()
    assert not other_folder.exists()


def test_old_builds_go(cache: Path) -> None:
    folders = [interrupt(f"{name}.safetensors", bytes(1000)).parent for name in ("old", "own", "new")]
    for age, folder in zip((40, 40, 1), folders, strict=True):
        touched = (folder / ".objectfolder").stat().st_mtime - 86_400 * age
        os.utime(folder / ".objectfolder", (touched, touched))
    with unfinished_build(Path("mug.obj"), Path("own.safetensors")):  # its own is never removed
        assert [folder.exists() for folder in folders] == [False, True, True]


def test_a_build_ends_with_the_first_stage_that_fails() -> None:
    class Failing:
        def finished(self, on_workers: object) -> object:
            for error in (None, Failure("mug", "too thick"), None):
                call = Call("views", "", Request("mug", {}, {}, {}, 0), (), "", {})
                yield Finished(Job(call), Outcome("mug", error))

    ended = list(UntilFailure(Failing()).finished(lambda busy, total: None))
    assert [end.outcome.failure is None for end in ended] == [True, False]
