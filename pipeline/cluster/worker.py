"""``objectfolder worker ADDRESS``: this machine works for a scheduler, and returns when it does."""

import argparse
import asyncio
import contextlib
import logging
import os
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from pipeline.cluster import tls
from pipeline.cluster.dask_settings import settings
from pipeline.cluster.pools import HOST, MEMORY, NOTHING, POOLS
from pipeline.sandbox import scratch

LOOPBACK = "127.0.0.1"
LOOK_S = 2.0  # between looks for a scheduler that is gone
CONNECT_S = 10.0
START_S = 120.0  # a worker's process may take to come up
CLOSE_S = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("address", help="of the scheduler: tls://HOST:PORT or tcp://HOST:PORT")
    parser.add_argument(
        "--tls", type=Path, metavar="FOLDER", help="certificates: a copy of .objectfolder/tls"
    )
    parser.add_argument("--workers", type=int, metavar="N", help="worker processes (default: one a core)")
    parser.add_argument(
        "--memory-gb", type=float, metavar="X", help="memory that their tasks may take together"
    )
    parser.add_argument(
        "--offers", metavar="POOLS", help="pools, as blender,gpu (default: what is installed)"
    )
    parser.add_argument(
        "--listen", metavar="HOST", help="own address (default: the one that faces the scheduler)"
    )
    parser.add_argument("--scratch", type=Path, metavar="DIR", help="folder for temporary files")
    parser.add_argument("--name", help="name of the worker, if it is one")
    parser.add_argument("--end-with-input", action="store_true", help="stop when standard input ends")
    parser.add_argument(
        "--gone-after",
        type=float,
        metavar="SECONDS",
        help="leave when the scheduler is gone so long (default: never)",
    )


def main(options: argparse.Namespace) -> int:
    """Work until told to stop by SIGTERM or SIGINT, or until the scheduler is gone for good."""
    folder = options.tls or tls.folder_of(Path.cwd(), options.address.startswith("tls://"))
    security = tls.security(folder) if folder else None
    tls.warn_if_open(options.listen or options.address, folder)
    if options.memory_gb is not None:
        os.environ[MEMORY] = str(options.memory_gb)
        # Memory given to these workers alone is no other's on this machine.
        os.environ.setdefault(HOST, f"{os.uname().nodename} ({os.getpid()})")
    with _temporary_files(options.scratch):
        return asyncio.run(_work(options, security))


async def _work(options: argparse.Namespace, security: Any) -> int:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        loop.add_signal_handler(number, stop.set)
    if options.end_with_input:
        loop.add_reader(sys.stdin.fileno(), lambda: None if os.read(sys.stdin.fileno(), 4096) else stop.set())
    count = options.workers or len(os.sched_getaffinity(0))
    await _keep(options, security, stop, count)
    return 0 if stop.is_set() else 1


async def _keep(options: argparse.Namespace, security: Any, stop: asyncio.Event, threads: int) -> None:
    """Keep one worker at work: a new one each time that the scheduler has gone and returned."""
    from distributed import Nanny

    while await _scheduler_answers(options, security, stop):
        try:
            async with Nanny(
                options.address,
                nthreads=threads,
                name=options.name,
                memory_limit=0,
                host=options.listen or _facing(options.address),
                dashboard_address=f"{LOOPBACK}:0",
                security=security,
                resources=_resources(options.offers),
                death_timeout=START_S,
                dashboard=False,
                silence_logs=logging.ERROR,
            ) as nanny:
                print(f"worker at {nanny.worker_address}", file=sys.stderr, flush=True)
                await _first(nanny.finished(), stop.wait())
                await nanny.close(timeout=CLOSE_S, reason="told to stop")
        except (OSError, RuntimeError, TimeoutError) as error:
            print(f"no worker for {options.address}: {error}", file=sys.stderr, flush=True)
        await _first(stop.wait(), asyncio.sleep(LOOK_S))


async def _scheduler_answers(options: argparse.Namespace, security: Any, stop: asyncio.Event) -> bool:
    """Wait for the scheduler; return whether there is one to work for."""
    from distributed.comm import connect

    loop = asyncio.get_running_loop()
    begun = loop.time()
    arguments = security.get_connection_args("worker") if security else {}
    while not stop.is_set():
        try:
            comm = await connect(options.address, timeout=CONNECT_S, **arguments)
            await comm.close()
            return True
        except OSError as error:
            gone = loop.time() - begun
            if options.gone_after is not None and gone >= options.gone_after:
                print(f"{options.address}: gone for {gone:.0f} s ({error})", file=sys.stderr, flush=True)
                return False
            await _first(stop.wait(), asyncio.sleep(LOOK_S))
    return False


async def _first(*awaitables: Any) -> None:
    """Wait for the first of several."""
    tasks = [asyncio.ensure_future(one) for one in awaitables]
    _, pending = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    for task in pending:
        task.cancel()
    await asyncio.gather(*pending, return_exceptions=True)


def _facing(scheduler: str) -> str:
    """Return the address of this machine that faces the scheduler."""
    from distributed.comm import get_address_host
    from distributed.utils import get_ip

    return str(get_ip(get_address_host(scheduler)))


def _resources(offers: str | None) -> dict[str, float] | None:
    if offers is None:
        return None
    named = [name.strip() for name in offers.split(",") if name.strip()]
    for name in named:
        if name not in (*POOLS, NOTHING):
            raise InputError(
                "--offers", f"unknown pool {name!r}", f"Known are {', '.join(POOLS)}, {NOTHING}."
            )
    return dict.fromkeys(named or [NOTHING], 1.0)


@contextlib.contextmanager
def _temporary_files(folder: Path | None) -> Iterator[None]:
    """Let temporary files of workers and tasks lie in one folder; Dask's own go at the end."""
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        os.environ["TMPDIR"] = str(folder.resolve())
        tempfile.tempdir = None
    scratch.sweep()
    own = scratch.Scratch("dask")
    try:
        with settings({"temporary-directory": str(own.path)}):
            yield
    finally:
        own.close()
