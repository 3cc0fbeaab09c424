"""Commands that other machines run: scheduler, worker."""

from argparse import Namespace
from pathlib import Path

from pipeline.cli.printing import FINE

LOOPBACK = "127.0.0.1"


def scheduler(
    *, host: str = LOOPBACK, port: int = 8786, dashboard: str = f"{LOOPBACK}:8787", tls: Path | None = None
) -> int:
    """Run a scheduler that workers and drivers come to.

    Parameters
    ----------
    host
        address to listen at
    dashboard
        HOST:PORT
    tls
        encrypt, with certificates made in this folder if it has none
    """
    from pipeline.cluster.scheduler import main

    return main(Namespace(host=host, port=port, dashboard=dashboard, tls=tls)) or FINE


def worker(
    address: str,
    /,
    *,
    tls: Path | None = None,
    workers: int | None = None,
    memory_gb: float | None = None,
    offers: str | None = None,
    listen: str | None = None,
    scratch: Path | None = None,
    name: str | None = None,
    end_with_input: bool = False,
    gone_after: float | None = None,
) -> int:
    """Work for a scheduler.

    Parameters
    ----------
    address
        of the scheduler: tls://HOST:PORT or tcp://HOST:PORT
    tls
        certificates: a copy of .objectfolder/tls
    workers
        worker processes (default: one a core)
    memory_gb
        memory that their tasks may take together
    offers
        pools, as blender,gpu (default: what is installed)
    listen
        own address (default: the one that faces the scheduler)
    scratch
        folder for temporary files
    name
        name of the worker, if it is one
    end_with_input
        stop when standard input ends
    gone_after
        seconds without the scheduler after which to leave (default: never)
    """
    from pipeline.cluster.worker import main

    options = Namespace(
        address=address,
        tls=tls,
        workers=workers,
        memory_gb=memory_gb,
        offers=offers,
        listen=listen,
        scratch=scratch,
        name=name,
        end_with_input=end_with_input,
        gone_after=gone_after,
    )
    return main(options)
