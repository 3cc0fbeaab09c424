"""Whatever a network does, a fetch ends complete and verified, or with an error that says what to do."""

import random
import signal
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from objectfolder.errors import ObjectFolderError
from pipeline.intake.sources.fetching import FETCHED, KEPT, Fetcher
from pipeline.intake.sources.recorded_hashes import read_hashes
from pipeline.intake.sources.registry import Resolutions
from tests.conftest import REPOSITORY
from tests.sources.file_server import FAULTS, at_random
from tests.sources.served_sources import IDS, YCB, ServedSources, files_in, tgz, ycb_members

HURRIED = {"retries": 4, "timeout_s": 0.25}


def run_once(tmp_path: Path, seed: int) -> str:
    """Fetch an object through faults of a seed, then without; return how the first ended."""
    chance = random.Random(seed)
    source_id = chance.choice(IDS)
    sources = ServedSources(tmp_path / "served").add_all()
    sources.server.plan = at_random(seed, rate=chance.choice((0.2, 0.5, 0.9)))
    sources.server.seed = seed
    hashes, fetched = tmp_path / "source_hashes.csv", tmp_path / "fetched"
    source_object = Resolutions().source_object(source_id)
    target = source_object.folder(fetched)
    with sources.server.listening() as base:
        downloader = sources.downloader(base, tmp_path / "cache", **HURRIED)
        refusal: ObjectFolderError | None = None
        try:
            Fetcher(fetched, downloader, hashes).fetch(source_object)
        except ObjectFolderError as error:
            refusal = error
        if refusal is None:
            assert files_in(target) == sources.expected[source_id]
        else:
            assert refusal.finding
            assert refusal.remedy
            assert not target.exists()
            assert read_hashes(hashes) == {}
        assert not [path for path in fetched.glob("*/.*") if path.suffix != ".lock"]
        sources.server.plan = lambda path: ""
        # What the faulty network left in the cache does no harm to a later fetch.
        got = Fetcher(fetched, sources.downloader(base, tmp_path / "cache"), hashes).fetch(source_object)
    assert files_in(got.folder) == sources.expected[source_id]
    assert set(read_hashes(hashes)) == {(source_id, path) for path in sources.expected[source_id]}
    assert got.outcome == (FETCHED if refusal else KEPT)
    return "refused" if refusal else "complete"


@pytest.mark.parametrize(
    "seeds", [range(20), pytest.param(range(20, 100), marks=pytest.mark.release("pipeline.intake"))], ids=len
)
def test_faulty_runs_end_complete_or_with_what_to_do(tmp_path, seeds):
    with ThreadPoolExecutor(8) as pool:  # they wait for most of the time
        outcomes = Counter(pool.map(lambda seed: run_once(tmp_path / str(seed), seed), seeds))
    assert outcomes.total() == len(seeds)
    assert outcomes["complete"] >= len(seeds) // 4
    assert outcomes["refused"] >= len(seeds) // 20


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_each_kind_once_is_got_over_or_told(tmp_path, kind):
    sources = ServedSources(tmp_path / "served").add_all()
    source_object = Resolutions().source_object(IDS[1])
    left = [kind]
    sources.server.plan = lambda path: left.pop() if left and path.endswith(".zip") else ""
    with sources.server.listening() as base:
        downloader = sources.downloader(base, tmp_path / "cache", timeout_s=0.5)
        fetcher = Fetcher(tmp_path / "fetched", downloader, tmp_path / "source_hashes.csv")
        if kind in ("403", "404", "loop"):
            with pytest.raises(ObjectFolderError) as caught:
                fetcher.fetch(source_object)
            assert caught.value.remedy
        got = fetcher.fetch(source_object)
    assert left == []
    assert files_in(got.folder) == sources.expected[IDS[1]]


@pytest.mark.slow
def test_a_fetch_that_is_killed_leaves_nothing_half_and_goes_on(tmp_path):
    sources = ServedSources(tmp_path / "served")
    members = ycb_members(YCB)
    members[f"{YCB}/google_16k/more.png"] = random.Random(1).randbytes(4_000_000)
    sources.add_ycb(YCB, archive=tgz(members))
    server = sources.server
    server.plan = lambda path: "slow" if path.endswith(".tgz") else ""
    with server.listening() as base:
        command = [
            sys.executable, "-c", "import sys; from pipeline.cli import main; sys.exit(main())",
            "fetch", IDS[0], "--folder", str(tmp_path / "fetched"), "--hashes", str(tmp_path / "hashes.csv"),
        ]  # fmt: skip
        for mirror in sources.mirrors(base):
            command += ["--mirror", mirror]
        started: list[subprocess.Popen[bytes]] = []

        def kill_half_way(count: int) -> None:
            if count > 2_000_000:
                started[0].send_signal(signal.SIGKILL)

        server.when_sent = kill_half_way
        started.append(subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.DEVNULL))
        assert started[0].wait() == -signal.SIGKILL
        assert not (tmp_path / "fetched" / "ycb" / YCB).exists()
        assert not (tmp_path / "hashes.csv").exists()
        server.when_sent = lambda count: None
        server.plan = lambda path: ""
        assert subprocess.run(command, cwd=REPOSITORY, stdout=subprocess.DEVNULL).returncode == 0
    assert files_in(tmp_path / "fetched" / "ycb" / YCB) == sources.expected[IDS[0]]
    assert not [path for path in (tmp_path / "fetched" / "ycb").glob(".*") if path.suffix != ".lock"]
