"""A process that reads objects from elsewhere, bounded in time and memory, and tells what it touched.

Run as a program: the objects come as lines of JSON on the standard input, what became of each goes to the
standard output, likewise.
"""

import faulthandler
import json
import os
import resource
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

MEMORY_BYTES = 3 * 2**30
"""What reading one object may take beyond what the process starts with."""

CPU_S = 10.0
"""Of one object, after which the process is ended by a signal."""

WALL_S = 900.0
"""Of one object: `CPU_S` on a machine that ninety processes share; only who waits takes so long."""

_WATCHED = (
    "open", "socket.connect", "socket.getaddrinfo", "subprocess.Popen", "os.system", "os.exec",
    "os.posix_spawn", "os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.symlink", "os.link",
)  # fmt: skip


def read_in_processes(objects: Sequence[dict[str, str]]) -> list[dict[str, Any]]:
    """Read objects in a child process, in another one after each that ends it, and say what became of them.

    Returns
    -------
    list
        For each: its entries and `outcome`, ``mesh``, ``refused``, ``ended`` (the process was, by a signal or
        for taking too long) or ``failed`` (another error); `said`; `seconds` of CPU time; `outside`, what it
        touched outside of its folder; `memory`, whether it asked for too much.
    """
    with tempfile.TemporaryDirectory() as empty:
        return _read_in_processes(objects, empty)


def _read_in_processes(objects: Sequence[dict[str, str]], folder: str) -> list[dict[str, Any]]:
    """Read objects in child processes that work in an empty folder."""
    reports: list[dict[str, Any]] = []
    while len(reports) < len(objects):
        rest = objects[len(reports) :]
        child = subprocess.run(
            [sys.executable, __file__, str(CPU_S), folder],
            input="".join(json.dumps(entry) + "\n" for entry in rest),
            capture_output=True,
            text=True,
            timeout=WALL_S * len(rest) + 60,
            env=os.environ
            | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"},
            cwd=Path(__file__).parents[2],
            check=False,
        )
        lines = [json.loads(line) for line in child.stdout.splitlines()]
        reports += [dict(entry) | line for entry, line in zip(rest, lines, strict=False)]
        if len(lines) < len(rest):
            said = f"the process ended with {child.returncode}: {child.stderr[-3000:]}"
            if not lines and child.returncode == 1:
                raise RuntimeError(said)
            reports.append(
                dict(rest[len(lines)]) | {"outcome": "ended", "said": said, "outside": [], "memory": False}
            )
    return reports


def _main() -> None:
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from objectfolder.errors import FormatError, InputError
    from objectfolder.making.mesh.ingest import ingest_object
    from objectfolder.making.mesh.readers.load import source_files

    objects = [json.loads(line) for line in sys.stdin]
    if objects and any(entry["archive"] for entry in objects):
        from pipeline.intake.sources.unpacking import unpack
    _warm_up(ingest_object)
    os.chdir(sys.argv[2])
    touched: list[str] = []
    allowed: list[str] = []
    watching = [False]

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if watching[0] and event in _WATCHED and not _is_allowed(event, arguments, allowed):
            touched.append(f"{event} {arguments[0]!r}")

    sys.addaudithook(watch)
    size = _virtual_bytes()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY_BYTES, size + MEMORY_BYTES))
    for entry in objects:
        touched.clear()
        allowed[:] = [os.path.abspath(entry["folder"])]
        signal.setitimer(signal.ITIMER_PROF, float(sys.argv[1]))
        faulthandler.dump_traceback_later(WALL_S, exit=True)
        start, outcome, said, memory = time.process_time(), "mesh", "", False
        watching[0] = True
        try:
            if entry["archive"]:
                unpack(Path(entry["archive"]), Path(entry["folder"]) / "unpacked")
            source_files(Path(entry["mesh"]))
            product = ingest_object(Path(entry["mesh"]), object_id="stranger")
            said = f"{len(product['faces'])} faces"
        except (InputError, FormatError) as problem:
            outcome, said = "refused", str(problem)
            memory = _asked_for_too_much(problem)
            if not problem.remedy or "\n" in said or len(said) > 2000:
                outcome = "failed"
        except BaseException as problem:
            outcome, said = "failed", "".join(traceback.format_exception(problem))[-3000:]
            memory = _asked_for_too_much(problem)
        watching[0] = False
        signal.setitimer(signal.ITIMER_PROF, 0)
        seconds = time.process_time() - start
        line = {"outcome": outcome, "said": said, "seconds": seconds, "outside": touched, "memory": memory}
        print(json.dumps(line), flush=True)


def _warm_up(ingest_object: Any) -> None:
    """Import all that reading imports when it is first needed."""
    import DracoPy
    import PIL.Image

    DracoPy.AttributeType(0)
    PIL.Image.init()
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "m.obj"
        mesh.write_text("v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
        ingest_object(mesh, object_id="warm")


def _asked_for_too_much(problem: BaseException | None) -> bool:
    """Whether memory ran out at the bottom of it."""
    return problem is not None and (
        isinstance(problem, MemoryError) or _asked_for_too_much(problem.__cause__)
    )


def _is_allowed(event: str, arguments: tuple[Any, ...], folders: Iterable[str]) -> bool:
    """Files of the object; and for reading what belongs to Python, which imports when it likes."""
    if not isinstance(arguments[0], str | bytes):
        return event == "open"  # a descriptor that is open already
    name = os.fsdecode(arguments[0])
    if os.path.basename(name) == name not in (".", ".."):
        return True  # relative to a folder that is open already: the current one is empty
    path = os.path.abspath(name)
    if any(Path(path).is_relative_to(folder) for folder in folders):
        return True
    mode = arguments[1] if event == "open" and len(arguments) > 1 else None
    reads = event == "open" and (mode is None or not set(str(mode)) & set("wax+"))
    homes = {sys.prefix, sys.base_prefix, sysconfig.get_path("stdlib"), str(Path(__file__).parents[2])}
    code = path.endswith((".py", ".pyc", ".so", ".json", ".toml", "METADATA"))
    return reads and code and any(Path(path).is_relative_to(home) for home in homes)


def _virtual_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


if __name__ == "__main__":
    _main()
