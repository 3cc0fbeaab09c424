"""``objectfolder scheduler``: a scheduler of its own, which workers and drivers come and go to."""

import argparse
import asyncio
import logging
import signal
import sys
from pathlib import Path
from typing import Any

from pipeline.cluster import tls
from pipeline.cluster.dask_settings import settings

PORT = 8786
LOOPBACK = "127.0.0.1"
DASHBOARD = f"{LOOPBACK}:8787"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what the command takes."""
    parser.add_argument("--host", default=LOOPBACK, help=f"address to listen at (default: {LOOPBACK})")
    parser.add_argument("--port", type=int, default=PORT, help=f"default: {PORT}")
    parser.add_argument("--dashboard", default=DASHBOARD, metavar="HOST:PORT", help=f"default: {DASHBOARD}")
    parser.add_argument(
        "--tls",
        type=Path,
        nargs="?",
        const=tls.DEFAULT,
        metavar="FOLDER",
        help=f"encrypt, with certificates made in FOLDER if it has none (default: {tls.DEFAULT})",
    )


def main(options: argparse.Namespace) -> int:
    """Schedule until told to stop by SIGTERM or SIGINT."""
    folder = options.tls or tls.folder_of(Path.cwd(), False)
    security = None
    if folder:
        tls.make(folder)
        security = tls.security(folder)
    tls.warn_if_open(options.host, folder)
    with settings():
        return asyncio.run(_schedule(options, security))


async def _schedule(options: argparse.Namespace, security: Any) -> int:
    from distributed import Scheduler

    logging.getLogger("distributed").setLevel(logging.ERROR)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    async with Scheduler(
        host=options.host,
        port=options.port,
        security=security,
        protocol="tls" if security else "tcp",
        dashboard_address=options.dashboard,
    ) as scheduler:
        print(f"scheduler at {scheduler.address}", file=sys.stderr, flush=True)
        await stop.wait()
        await scheduler.close()
    return 0
