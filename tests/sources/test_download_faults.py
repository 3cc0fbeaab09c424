"""A fetch disturbed in any way ends complete, or says what to do; killed, it goes on where it was."""

import hashlib
import queue
import random
import shutil
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.intake.sources.cached_file import CachedFile
from pipeline.intake.sources.download import Downloader
from pipeline.intake.sources.unpacking import unpack
from tests.sources.file_server import FAULTS, HARMLESS, FileServer, at_random, no_faults
from tests.sources.hostile_archives import KINDS, MAKERS, tree
from tests.sources.served_file import AMPLE, CONTENT, MD5, ranges, whole_files

REPOSITORY = Path(__file__).parents[2]
RUNS = 100
COMPLETE = "complete"
PASSING = (*HARMLESS, "429", "500", "503", "reset", "cut", "short", "stall", "other range")
BRIEF = {**AMPLE, "retries": 5, "timeout_s": 0.2}


def fetched(downloader: Downloader, url: str, md5: str | None, target: Path) -> None:
    """Fetch and unpack, as a source does."""
    path = downloader.file(url, md5=md5)
    try:
        unpack(path, target)
    except FormatError:
        downloader.forget(url)
        shutil.rmtree(target, ignore_errors=True)
        raise


@dataclass(frozen=True)
class Archive:
    """One that is served: what it holds, and what is known of it beforehand."""

    name: str
    members: dict[str, bytes]
    content: bytes
    md5: str | None


def made_archives(folder: Path, chance: random.Random) -> list[Archive]:
    """Put one of each kind into a folder."""
    folder.mkdir(parents=True)
    archives = []
    for kind in KINDS:
        members = {
            f"{kind}/{name}": chance.randbytes(chance.randrange(100_000)) for name in ("a", "b/c", "b/d")
        }
        content = MAKERS[kind](members.items())
        # A byte that changed on the way is seen by its md5, or else by the checksums of a zip or gzip.
        known = chance.random() < 0.5
        archives.append(Archive(kind, members, content, hashlib.md5(content).hexdigest() if known else None))
        (folder / kind).write_bytes(content)
    return archives


def disturbed_run(folder: Path, seed: int) -> tuple[str, Counter[str]]:
    """Fetch archives from a server of random faults, and then again without; return how the first ended."""
    chance = random.Random(seed)
    archives = made_archives(folder / "served", chance)
    kinds = chance.choice([FAULTS, PASSING])
    kinds = tuple(chance.sample(kinds, chance.randrange(3, len(kinds))))
    server = FileServer(
        folder / "served", plan=at_random(seed, chance.choice([0.5, 0.7, 0.9]), kinds), seed=seed
    )
    if chance.random() < 0.3:
        server.headers = {"ETag": ""}  # and the files are too young to be told by their time
    errors = []
    with server.listening() as base:
        for timing in (BRIEF, AMPLE):
            for archive in archives:
                target = folder / "objects" / archive.name
                url = f"{base}/{archive.name}"
                if target.exists():
                    continue
                try:
                    fetched(Downloader(folder / "cache", **timing), url, archive.md5, target)
                except ObjectFolderError as raised:
                    assert not target.exists()
                    errors.append(raised)
                else:
                    assert tree(target) == archive.members
                whole = CachedFile(folder / "cache", url, url).path
                if whole.exists():
                    assert whole.read_bytes() == archive.content
            if timing is BRIEF:
                faults, server.plan, disturbed = Counter(server.faults), no_faults, list(errors)
        assert len(errors) == len(disturbed)
    assert {path.name for path in (folder / "objects").iterdir()} == set(KINDS)
    assert all(error.remedy for error in errors)
    assert faults or not errors
    return type(errors[0]).__name__ if errors else COMPLETE, faults


@pytest.mark.slow
def test_a_hundred_disturbed_fetches_end_complete_or_say_what_to_do(tmp_path):
    ended: Counter[str] = Counter()
    faults: Counter[str] = Counter()
    for seed in range(RUNS):
        how, met = disturbed_run(tmp_path / str(seed), seed)
        ended[how] += 1
        faults += met
    print(dict(ended), dict(faults))
    assert set(faults) == set(FAULTS)
    assert faults.total() > RUNS
    assert RUNS // 4 < ended[COMPLETE] < RUNS


@pytest.mark.parametrize("seed", range(3))
def test_faults_that_pass_end_complete(tmp_path, seed):
    """Where it is asked often enough, nothing but time is lost."""
    (tmp_path / "a.bin").write_bytes(CONTENT)
    quick = tuple(kind for kind in PASSING if kind != "stall")
    server = FileServer(tmp_path, plan=at_random(seed, 0.7, quick), seed=seed)
    with server.listening() as base:
        path = Downloader(tmp_path / "cache", **AMPLE).file(f"{base}/a.bin", md5=MD5)
    assert path.read_bytes() == CONTENT


CODE = """
import sys
from pathlib import Path
from pipeline.intake.sources.download import Downloader
print(Downloader(Path(sys.argv[1])).file(sys.argv[2]))
"""


def test_a_killed_fetch_goes_on_where_it_was(tmp_path):
    """Of a process killed three times, no byte comes twice."""
    content = CONTENT * 10
    served = tmp_path / "served"
    served.mkdir()
    (served / "large").write_bytes(content)
    server = FileServer(served)
    cache = tmp_path / "cache"
    with server.listening() as base:
        url = f"{base}/large"
        partial = CachedFile(cache, url, url).partial
        started: queue.SimpleQueue[subprocess.Popen[bytes]] = queue.SimpleQueue()
        for quarter in (1, 2, 3):

            def kill(sent: int, at: int = quarter * len(content) // 4) -> None:
                """Once all that was sent is written; so sent is what there is to go on from."""
                if sent >= at:
                    process = started.get(timeout=60)
                    while not partial.exists() or partial.stat().st_size < sent:
                        assert process.poll() is None
                    process.kill()
                    process.wait()  # or it sees the connection end, and asks again
                    raise ConnectionResetError

            server.when_sent = kill
            with subprocess.Popen([sys.executable, "-c", CODE, str(cache), url], cwd=REPOSITORY) as process:
                started.put(process)
            assert process.returncode == -signal.SIGKILL
            assert not whole_files(cache)
            assert partial.read_bytes() == content[: server.bytes_sent]
            assert quarter * len(content) // 4 <= server.bytes_sent < len(content)
        server.when_sent = lambda sent: None
        before = server.bytes_sent
        assert Downloader(cache, **AMPLE).file(url).read_bytes() == content
    assert server.bytes_sent == len(content)
    assert ranges(server)[-1] == f"bytes={before}-"
    assert len(server.requests) == 4
