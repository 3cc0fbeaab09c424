"""A fetch disturbed in any way ends complete, or says what to do; killed, it goes on where it was."""

import queue
import signal
import subprocess
import sys
from pathlib import Path

from pipeline.intake.sources.download import CachedFile, Downloader
from tests.sources.file_server import HARMLESS, FileServer, at_random
from tests.sources.served_file import AMPLE, CONTENT, MD5, ranges, whole_files

REPOSITORY = Path(__file__).parents[2]
PASSING = (*HARMLESS, "429", "500", "503", "reset", "cut", "short", "stall", "other range")


def test_faults_that_pass_end_complete(tmp_path):
    """Where it is asked often enough, nothing but time is lost."""
    (tmp_path / "a.bin").write_bytes(CONTENT)
    quick = tuple(kind for kind in PASSING if kind != "stall")
    server = FileServer(tmp_path, plan=at_random(1, 0.7, quick), seed=1)
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
        partial = CachedFile(cache, url).partial
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
