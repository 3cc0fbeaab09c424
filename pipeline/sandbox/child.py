"""The process in which task bodies run; `pipeline.sandbox.guard` starts it and ends what it leaves.

Its standard input and what was its standard output are ends of pipes (`multiprocessing.Pipe`): it receives
calls and sends outcomes. The task's own output goes to standard error. It works in a scratch folder, where
native code may leave what it likes. A call whose code is not the code that is loaded here is refused with
`STALE`.
"""

import contextlib
import ctypes
import importlib
import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Iterator, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

from objectfolder.child_process import end_with
from objectfolder.errors import InputError
from objectfolder.products.provenance import code_identity
from pipeline.dataset.products import TENSORS, ZARR, kind_name
from pipeline.dataset.task import Call, Outcome, Timed, failure_of
from pipeline.dataset.verified import known_sources
from pipeline.store import shared
from pipeline.store.storage import disk_error, product_name

STALE = "stale"
MKL, TORCH = "mkl", "torch"  # as distributions are named


def execute(call: Call) -> Outcome:
    """Run a task body, write its products with their provenance, and say what it cost."""
    begin, cpu = time.perf_counter(), _cpu_seconds()
    offspring = _largest_offspring_bytes()
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # the peak is that of this task
    failure = None
    query_seconds: Mapping[str, float] = {}
    try:
        module, _, function = call.task.partition(":")
        returned = getattr(importlib.import_module(module), function)(call.request)
        if isinstance(returned, Timed):
            returned, query_seconds = returned.products, returned.query_seconds
        contents = returned if isinstance(returned, tuple) else (returned,)
        if len(contents) != len(call.targets):
            raise TypeError(
                f"{call.task} returned {len(contents)} products where {len(call.targets)} are declared"
            )
        for target, content in zip(call.targets, contents, strict=True):
            try:
                write_content(target, content, call.fingerprint, dict(call.parts))
            except OSError as error:
                raise disk_error(error, target.parent) from error
            if call.state is not None:
                name = product_name(call.fingerprint, kind_name(target))
                shared.share(call.state, name, target)
    except (Exception, SystemExit) as error:
        failure = failure_of(call.request.object_id, error, traceback.format_exc(limit=-12))
    return Outcome(
        call.request.object_id,
        failure,
        time.perf_counter() - begin,
        _cpu_seconds() - cpu,
        max(_peak_bytes(), _largest_offspring_bytes() if _largest_offspring_bytes() > offspring else 0),
        call.fingerprint,
        query_seconds,
    )


def write_content(path: Path, content: object, fingerprint: str, provenance: dict[str, Any]) -> None:
    """Write what a task returned, with its provenance, atomically.

    Raises
    ------
    TypeError
        `content` is not what the suffix of `path` asks for.
    """
    from objectfolder.products.store import Product, write_product
    from objectfolder.products.tensor_file import TensorFile, write_tensor_file

    if path.name.endswith(ZARR) and isinstance(content, Product):
        write_product(path, content.with_attributes(fingerprint=fingerprint, provenance=provenance))
    elif path.name.endswith(TENSORS) and isinstance(content, TensorFile):
        write_tensor_file(path, content.with_metadata(fingerprint=fingerprint, provenance=provenance))
    else:
        raise TypeError(f"{path.name} cannot hold a {type(content).__name__}")


def serve(guard: int, scratch: str) -> NoReturn:
    """Serve calls in a scratch folder until standard input ends, or the `guard` that forked this process."""
    end_with(guard)
    code = _LoadedCode(known_sources(Path.cwd()))
    os.chdir(scratch)
    answers = Connection(os.dup(1), readable=False)
    os.dup2(2, 1)  # what native code prints must not mix with the answers
    # A clean exit at interruption is the parent's to decide.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for call in _calls():
        answer: Outcome | str = STALE
        if code.serves(call):  # a shipment runs itself: what it imports is not needed by every child
            answer = execute(call) if type(call) is Call else call.run(execute)
        sys.stdout.flush()
        with contextlib.suppress(OSError, AttributeError):  # other C libraries than glibc do so by themselves
            ctypes.CDLL(None).malloc_trim(0)
        answers.send(answer)
    os._exit(0)  # native libraries may crash while they are unloaded, which no longer matters


def _calls() -> Iterator[Any]:
    calls = Connection(os.dup(0), writable=False)
    with contextlib.suppress(EOFError):
        while True:
            yield calls.recv()


class _LoadedCode:
    """The code that is loaded in this process, to compare with the code that a product would name.

    Digests of modules are from before their import. Once loaded, MKL lends its exponential to a torch that
    is imported after it, and what tasks yield would depend on what this process did before.
    """

    def __init__(self, cache: dict[str, Any]) -> None:
        self._cache = cache
        self._digests: dict[str, str] = {}
        self._mkl_alone = False

    def serves(self, call: Call) -> bool:
        """Whether a task yields here what it would yield in a new process with the code it names.

        Its modules are compared on disk too, because a task may start processes of its own.
        """
        packages = call.parts.get("packages", {})
        if self._mkl_alone and TORCH in packages:
            return False
        self._mkl_alone |= MKL in packages and TORCH not in sys.modules
        named_code = call.parts.get("code")
        if named_code is None:
            return True
        try:
            current_code = code_identity(call.task.partition(":")[0], self._cache)
        except InputError:
            return True  # the import will say what is wrong
        self._digests = {**current_code, **self._digests}
        return current_code == named_code and all(
            self._digests[name] == digest for name, digest in named_code.items()
        )


def _cpu_seconds() -> float:
    used = (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def _largest_offspring_bytes() -> int:
    """Return the peak of the largest process this one ever started and waited for."""
    return 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss


def _peak_bytes() -> int:
    with contextlib.suppress(OSError, StopIteration, ValueError):
        lines = Path("/proc/self/status").read_text().splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
