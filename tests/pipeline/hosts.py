"""Several hosts on one machine: network namespaces with addresses of their own on one bridge.

Each host sees its own folder and none of the others', has its own name and loopback, and can be cut
off, slowed down and killed. No privilege is needed where users may make namespaces.
"""

import contextlib
import functools
import os
import signal
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import psutil

REPOSITORY = Path(__file__).parents[2]
SUBNET = "10.177.0"
# Says when it stands, and goes with the process that holds its standard input.
HOLDER = "echo ready; exec cat"


@dataclass(frozen=True)
class Cable:
    """A link; each direction has the delay, rate and loss."""

    delay_s: float
    rate_bit_s: float
    loss: float
    seed: int = 0


@functools.cache
def why_not() -> str | None:
    """Return why hosts cannot be made here, None where they can."""
    try:
        with Network(Path("/tmp"), ()) as network:
            network.switch_run("ip", "link", "add", "probe", "type", "veth", "peer", "name", "other")
            network.switch_run("unshare", "--net", "--mount", "--uts", "true")
    except (OSError, RuntimeError) as error:
        return f"network namespaces are not permitted here: {error}"
    return None


@functools.cache
def why_no_cable() -> str | None:
    """Return why the link of a host cannot be changed here, None where it can."""
    return why_not() or (None if os.access("/dev/net/tun", os.R_OK | os.W_OK) else "/dev/net/tun is closed")


class Host:
    """A machine of its own, as far as network, name and data folder go."""

    def __init__(self, network: "Network", name: str, number: int, changeable: bool) -> None:
        self.name = name
        self.address = f"{SUBNET}.{number}"
        self.folder = network.folder / name
        self._network = network
        self._port = f"port{number}"
        self._started: list[subprocess.Popen[bytes]] = []
        (self.folder / "tmp").mkdir(parents=True, exist_ok=True)
        self._holder = _hold(
            [*network.enter(), "unshare", "--net", "--mount", "--uts", "sh", "-c", HOLDER], name
        )
        self._carrier: subprocess.Popen[bytes] | None = None
        if not changeable:
            network.switch_run(
                *("ip", "link", "add", self._port, "type", "veth", "peer"),
                *("name", "eth0", "netns", str(self._holder.pid)),
            )
        else:
            self._lay(number)
        network.switch_run("ip", "link", "set", self._port, "master", "switch", "up")
        for command in (
            f"hostname {name}",
            "ip link set lo up",
            f"ip address add {self.address}/24 dev eth0",
            "ip link set eth0 up",
            f"ip route add default dev eth0 src {self.address}",
        ):
            _run([*self._enter(), *command.split()])

    def settle(self, hosts: Sequence["Host"]) -> None:
        """Know the hosts by name, and cover the folders of the others: there is no shared disk."""
        names = "".join(f"{host.address} {host.name}\n" for host in hosts)
        for file, content in (("hosts", f"127.0.0.1 localhost\n{names}"), ("resolv.conf", "")):
            (self.folder / "tmp" / file).write_text(content)
            _run([*self._enter(), "mount", "--bind", str(self.folder / "tmp" / file), f"/etc/{file}"])
        _run([*self._enter(), "mount", "--bind", str(self.folder / "tmp"), "/var/tmp"])
        for host in hosts:
            if host is not self:
                _run([*self._enter(), "mount", "-t", "tmpfs", "none", str(host.folder)])

    def start(
        self, *command: str, log: str = "log", environment: Mapping[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a command in the host's folder; its output goes to a file there."""
        settings = {
            "TMPDIR": str(self.folder / "tmp"),
            "PYTHONPATH": os.pathsep.join([str(self.folder), str(REPOSITORY)]),
            "PYTHONUNBUFFERED": "1",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
            **(environment or {}),
        }
        with open(self.folder / log, "ab") as output:
            process = subprocess.Popen(
                [
                    *self._enter(),
                    "env",
                    "-C",
                    str(self.folder),
                    *(f"{k}={v}" for k, v in settings.items()),
                    *command,
                ],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                start_new_session=True,
            )
        self._started.append(process)
        return process

    def python(self, *arguments: str, **options: Any) -> subprocess.Popen[bytes]:
        """Start this Python."""
        return self.start(sys.executable, *arguments, **options)

    def cut(self) -> None:
        """Cut it off silently: as with a switch that fails, nobody is told."""
        self._network.switch_run("ip", "link", "set", self._port, "nomaster")

    def mend(self) -> None:
        """Connect it again."""
        self._network.switch_run("ip", "link", "set", self._port, "master", "switch")

    def spoil(self, cable: Cable) -> None:
        """Make the link as poor as `cable`; for a host whose link can be changed."""
        assert self._carrier is not None
        assert self._carrier.stdin is not None
        line = f"{cable.delay_s} {cable.rate_bit_s} {cable.loss} {cable.seed}\n"
        self._carrier.stdin.write(line.encode())
        self._carrier.stdin.flush()

    def processes(self) -> list[psutil.Process]:
        """Return all that runs in the network of the host, its holder left out."""
        mine = os.readlink(f"/proc/{self._holder.pid}/ns/net")
        processes = []
        for process in psutil.process_iter():
            with contextlib.suppress(OSError, psutil.Error):
                if process.pid != self._holder.pid and os.readlink(f"/proc/{process.pid}/ns/net") == mine:
                    processes.append(process)
        return processes

    def kill(self) -> None:
        """End all that runs here, as a power cut does."""
        while running := self.processes():
            for process in running:
                with contextlib.suppress(psutil.Error):
                    process.send_signal(signal.SIGKILL)
            psutil.wait_procs(running, timeout=5)
        for process in self._started:
            process.wait()
        self._started.clear()

    def read(self, log: str = "log") -> str:
        """Return what was written to a file of the host so far."""
        path = self.folder / log
        return path.read_text(errors="replace") if path.exists() else ""

    def close(self) -> None:
        """End all that belongs to it."""
        self.kill()
        for holder in (self._carrier, self._holder):
            if holder is not None:
                _release(holder)

    def _enter(self) -> list[str]:
        return ["nsenter", "--target", str(self._holder.pid), *_NAMESPACES, "--mount", "--uts", "--"]

    def _lay(self, number: int) -> None:
        far = f"far{number}"
        script = str(Path(__file__).with_name("slow_link.py"))
        self._carrier = _hold([*self._network.enter(), sys.executable, script, self._port, far], far)
        self._network.switch_run("ip", "link", "set", far, "netns", str(self._holder.pid), "name", "eth0")


class Network:
    """A bridge, and hosts on it.

    Parameters
    ----------
    folder
        Gets a folder for each host.
    names
        Names of the hosts.
    changeable
        Names of the hosts whose link can be made poor.
    """

    def __init__(self, folder: Path, names: Sequence[str], changeable: Collection[str] = ()) -> None:
        self.folder = folder
        self.hosts: dict[str, Host] = {}
        self._switch = _hold(["unshare", "--map-root-user", "--net", "sh", "-c", HOLDER], "switch")
        try:
            if names:
                self.switch_run("ip", "link", "add", "switch", "type", "bridge")
                self.switch_run("ip", "link", "set", "switch", "up")
            for number, name in enumerate(names, start=2):
                self.hosts[name] = Host(self, name, number, name in changeable)
            for host in self.hosts.values():
                host.settle(list(self.hosts.values()))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Network":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __getitem__(self, name: str) -> Host:
        return self.hosts[name]

    def switch_run(self, *command: str) -> None:
        _run([*self.enter(), *command])

    def enter(self) -> list[str]:
        return ["nsenter", "--target", str(self._switch.pid), *_NAMESPACES, "--"]

    def close(self) -> None:
        """End all hosts; no namespace and no process stays."""
        for host in self.hosts.values():
            host.close()
        _release(self._switch)


_NAMESPACES = ("--user", "--preserve-credentials", "--net")


def _hold(command: Sequence[str], name: str) -> subprocess.Popen[bytes]:
    holder = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    )
    assert holder.stdout is not None
    assert holder.stderr is not None
    if holder.stdout.readline() != b"ready\n":
        holder.kill()
        raise RuntimeError(f"{name}: {holder.stderr.read().decode().strip()}")
    return holder


def _release(holder: subprocess.Popen[bytes]) -> None:
    holder.kill()
    holder.wait()
    for stream in (holder.stdin, holder.stdout, holder.stderr):
        if stream is not None:
            stream.close()


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
