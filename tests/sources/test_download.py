"""Files from a server come whole and verified, or not at all."""

import concurrent.futures
import gzip
import hashlib
import re
import subprocess
import sys
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest

from objectfolder.errors import FormatError, InputError, ObjectFolderError
from pipeline.intake.sources.download import Downloader, cached_path
from tests.pipeline.http_faults import serving
from tests.sources.file_server import HARMLESS, scripted
from tests.sources.served_file import AMPLE, CONTENT, MD5, SHORT, whole_files

REPOSITORY = Path(__file__).parents[2]


def test_a_file_comes_once(file_server, address, cache_folder):
    reports: list[tuple[str, int, int | None]] = []
    downloader = Downloader(cache_folder, progress=lambda *said: reports.append(said), **AMPLE)
    url = f"{address}/a.bin"
    path = downloader.file(url, md5=MD5.upper(), size=len(CONTENT))
    assert path.read_bytes() == CONTENT
    assert path.name == "a.bin"
    assert path.is_relative_to(cache_folder)
    assert reports[0] == (url, 0, len(CONTENT))
    assert reports[-1] == (url, len(CONTENT), len(CONTENT))
    assert [count for _, count, _ in reports] == sorted(count for _, count, _ in reports)
    assert downloader.file(url) == path
    assert len(file_server.requests) == 1
    (_, _, headers) = file_server.requests[0]
    assert headers["user-agent"].startswith("objectfolder-factory/")
    assert headers["accept-encoding"] == "identity"
    downloader.forget(url)
    assert not path.exists()
    assert downloader.file(url).read_bytes() == CONTENT
    assert len(file_server.requests) == 2


@pytest.mark.parametrize("kind", [*HARMLESS, "429", "500", "503", "reset", "cut", "short", "stall"])
def test_what_passes_is_waited_for(file_server, address, cache_folder, kind):
    file_server.plan = scripted(kind)
    timing = {**AMPLE, "timeout_s": 2.0} if kind == "stall" else AMPLE
    assert Downloader(cache_folder, **timing).file(f"{address}/a.bin").read_bytes() == CONTENT
    assert file_server.faults == {kind: 1}
    assert file_server.bytes_sent >= len(CONTENT)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("wrong", {"md5": MD5}),
        ("truncated", {"size": len(CONTENT)}),
        ("", {"size": 5}),
        ("", {"md5": "0" * 32}),
    ],
)
def test_another_content_is_refused_by_both_values(file_server, address, cache_folder, kind, expected):
    file_server.plan = scripted(kind)
    with pytest.raises(FormatError) as refused:
        Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin", **expected)
    ((name, value),) = expected.items()
    assert f"its {name} is " in refused.value.finding
    assert f", not {value}" in refused.value.finding
    assert refused.value.remedy
    assert not whole_files(cache_folder)
    assert not list(cache_folder.rglob(".*.partial"))
    if kind:
        assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin", **expected).read_bytes() == CONTENT


def test_a_kept_file_gives_way_to_the_one_wanted_and_to_no_other(file_server, address, cache_folder):
    downloader = Downloader(cache_folder, **AMPLE)
    path = downloader.file(f"{address}/a.bin")
    with pytest.raises(FormatError):
        downloader.file(f"{address}/a.bin", md5="0" * 32)
    assert path.read_bytes() == CONTENT
    new = CONTENT[::-1]
    (file_server.folder / "a.bin").write_bytes(new)
    assert downloader.file(f"{address}/a.bin").read_bytes() == CONTENT
    assert downloader.file(f"{address}/a.bin", md5=hashlib.md5(new).hexdigest()).read_bytes() == new


def test_labels_of_encoding_change_nothing(file_server, address, cache_folder):
    packed = gzip.compress(CONTENT[:1000])
    (file_server.folder / "a.tgz").write_bytes(packed)
    file_server.headers = {"Content-Encoding": "gzip"}
    assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.tgz").read_bytes() == packed


@pytest.mark.parametrize("kind", ["", "chunked"])
def test_no_more_than_allowed(file_server, address, cache_folder, kind):
    file_server.plan = scripted(kind)
    with pytest.raises(InputError, match="larger than 200000 bytes"):
        Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin", limit_bytes=200_000)
    assert not whole_files(cache_folder)
    assert not list(cache_folder.rglob(".*.partial"))


def test_a_server_that_sends_nothing_new_is_given_up(file_server, address, cache_folder):
    file_server.plan = scripted(*["stall"] * 1000)
    with pytest.raises(InputError, match="does not answer in time") as refused:
        Downloader(cache_folder, **SHORT).file(f"{address}/a.bin")
    assert refused.value.remedy
    file_server.plan = scripted()
    assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin").read_bytes() == CONTENT


def test_what_a_killed_process_left_is_removed(address, cache_folder):
    path = cached_path(cache_folder, f"{address}/a.bin")
    path.parent.mkdir(parents=True)
    (path.parent / ".a.bin.x.partial").write_bytes(b"half")
    assert Downloader(cache_folder, **AMPLE).file(f"{address}/a.bin").read_bytes() == CONTENT
    assert not list(cache_folder.rglob(".*.partial"))


def test_names_in_addresses_stay_in_the_cache(cache_folder, file_server, address):
    for target in ("/", "/?q=1", "/..%2F..%2Fescaped", "/.hidden", "/%E4%BC%9A.zip"):
        file_server.documents[target] = target.encode()
        path = Downloader(cache_folder, **AMPLE).file(address + target)
        assert path.read_text() == target
        assert path.parent.parent == cache_folder
    for target in (
        "/..",
        "/%2e%2e%2fx",
        "/.lock",
        "/.partial",
        "/a%00b",
        "/a%0Ab",
        "/" + "x" * 300,
        "/%FF",
        "/\ud800",
    ):
        name = cached_path(cache_folder, address + target).name
        assert re.fullmatch(r"[A-Za-z0-9_-][A-Za-z0-9._-]{0,99}", name), (target, name)


def test_threads_and_processes_fetch_a_file_once(file_server, address, cache_folder):
    file_server.plan, file_server.drip_s = scripted("slow"), 0.02
    downloader = Downloader(cache_folder, **AMPLE)
    code = (
        "import sys; from pathlib import Path; from pipeline.intake.sources.download import Downloader\n"
        "print(Downloader(Path(sys.argv[1])).file(sys.argv[2]))"
    )
    command = [sys.executable, "-c", code, str(cache_folder), f"{address}/a.bin"]
    processes = [
        subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) for _ in range(2)
    ]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        paths = set(pool.map(downloader.file, [f"{address}/a.bin"] * 8))
    paths |= {Path(process.communicate()[0].strip()) for process in processes}
    (path,) = paths
    assert path.read_bytes() == CONTENT
    assert file_server.bytes_sent == len(CONTENT)
    assert len(file_server.requests) == 1


def test_a_disk_that_fills_up_is_told(file_server, address, cache_folder):
    code = (
        "import resource, sys; from pathlib import Path\n"
        "from pipeline.intake.sources.download import Downloader\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))\n"
        "from objectfolder.errors import InputError\n"
        "try: Downloader(Path(sys.argv[1])).file(sys.argv[2])\n"
        "except InputError as error: print(error)"
    )
    command = [sys.executable, "-c", code, str(cache_folder), f"{address}/a.bin"]
    said = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    assert "cannot be read or written (File too large)" in said
    assert not whole_files(cache_folder)
    assert not list(cache_folder.rglob(".*.partial"))


def test_a_cache_that_cannot_be_written_is_told(address, tmp_path):
    (tmp_path / "cache").write_text("a file")
    with pytest.raises(InputError, match="cannot be read or written") as refused:
        Downloader(tmp_path / "cache", **AMPLE).file(f"{address}/a.bin")
    assert "permissions" in refused.value.remedy


def test_a_body_without_end_is_not_taken_for_whole(cache_folder):
    """Of a server that tells no length and closes the connection, cut bodies look like whole ones."""

    class Old(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.0"

        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(CONTENT)

        def log_message(self, *_: object) -> None:
            pass

    with serving(Old) as address:
        with pytest.raises(InputError, match="does not say how long it is") as refused:
            Downloader(cache_folder, **AMPLE).file(f"{address}/a")
        assert "mirror" in refused.value.remedy
        assert Downloader(cache_folder, **AMPLE).file(f"{address}/a", md5=MD5).read_bytes() == CONTENT
        assert (
            Downloader(cache_folder / "2", **AMPLE).file(f"{address}/a", size=len(CONTENT)).read_bytes()
            == CONTENT
        )
        with pytest.raises(ObjectFolderError):
            Downloader(cache_folder / "3", **SHORT).file(f"{address}/a", size=len(CONTENT) + 1)
