"""A scheduler in this process, with workers on machines that are reached by SSH."""

import asyncio
import contextlib
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from distributed.deploy.spec import ProcessInterface

from objectfolder.errors import InputError
from pipeline.cluster import tls
from pipeline.cluster.machine_cluster import spec_cluster
from pipeline.cluster.places import Place

AGAIN_S = 15.0  # until a machine that could not be reached, or whose workers ended, is tried again
TAIL_LINES = 5


@contextlib.contextmanager
def start(
    place: Place, root: Path, jobs_at_most: int, security: Any, certificates: Path | None
) -> Iterator[str]:
    """Start a scheduler here and workers there; yield the scheduler's address.

    Raises
    ------
    InputError
        The package that speaks SSH is missing.
    """
    try:
        import asyncssh  # noqa: F401
    except ImportError as error:
        remedy = "pip install 'objectfolder-factory[ssh]'"
        raise InputError("ssh", "the package asyncssh is not installed", remedy) from error
    options = {"place": place, "root": root, "certificates": certificates}
    workers = {
        host: {"cls": SshMachine, "options": {"host": host, **options}}
        for host in place.ssh.hosts[:jobs_at_most]
    }
    with spec_cluster(place, security, workers) as cluster:
        yield cluster.scheduler_address


class SshMachine(ProcessInterface):
    """The workers of one machine; when they end, or it cannot be reached, it is tried again.

    Parameters
    ----------
    scheduler
        Address of the scheduler.
    host
        The machine, ``[user@]name``.
    place
        Where to run.
    root
        The data folder here.
    certificates
        Folder of the certificates here; they are sent along.
    name
        Of the machine in the cluster.
    """

    def __init__(
        self, scheduler: str, host: str, place: Place, root: Path, certificates: Path | None, name: str
    ) -> None:
        super().__init__(scheduler=scheduler, name=name)
        self._machine = host
        self._options = dict(place.ssh.connect)
        user, _, self._address = host.rpartition("@")
        if user:
            self._options["username"] = user
        self._script = script(scheduler, place, root, certificates)
        self._keeper: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Begin; whether the machine can be reached shows later."""
        self._keeper = asyncio.create_task(self._keep())
        await super().start()

    async def close(self, **_: Any) -> None:
        """End the workers: they stop when their input does."""
        if self._keeper is not None:
            self._keeper.cancel()
            await asyncio.gather(self._keeper, return_exceptions=True)
        await super().close()

    async def _keep(self) -> None:
        import asyncssh

        while True:
            try:
                async with asyncssh.connect(self._address, **self._options) as connection:
                    why = await self._work(connection)
            except (OSError, asyncssh.Error) as error:
                why = str(error) or type(error).__name__
            print(f"{self._machine}: {why}; tried again in {AGAIN_S:g} s", file=sys.stderr)
            await asyncio.sleep(AGAIN_S)

    async def _work(self, connection: Any) -> str:
        """Run the workers until they end; return what they said last."""
        async with connection.create_process("sh -s", stderr=asyncio.subprocess.STDOUT) as process:
            process.stdin.write(self._script)
            lines: list[str] = []
            async for line in process.stdout:
                lines = [*lines, line.strip()][-TAIL_LINES:]
            status = (await process.wait()).exit_status
        return f"its workers ended (exit {status}): {' | '.join(lines)}"


def script(scheduler: str, place: Place, root: Path, certificates: Path | None) -> str:
    """Return what a shell on the machine is to run; secrets come this way, not by a command line."""
    ssh = place.ssh
    command = [ssh.python or sys.executable, "-m", "pipeline.cli", "worker", scheduler, "--end-with-input"]
    if place.workers is not None:
        command += ["--workers", str(place.workers)]
    if place.memory_gb is not None:
        command += ["--memory-gb", str(place.memory_gb)]
    command += ["--gone-after", str(place.reconnect_s)]
    lines = ["set -e", f"cd {shlex.quote(ssh.folder or str(root))}"]
    lines += [f"export {name}={shlex.quote(value)}" for name, value in ssh.environment.items()]
    end = ""
    if certificates is not None:
        lines += ["umask 077", "tls=$(mktemp -d)", "trap 'rm -rf \"$tls\"' EXIT"]
        for name in tls.FILES:
            lines += [f"cat > \"$tls/{name}\" <<'END'", (certificates / name).read_text().rstrip("\n"), "END"]
        lines.append("umask 022")
        end = ' --tls "$tls"'
    return "\n".join([*lines, f"{shlex.join(command)}{end}", "exit $?", ""])
