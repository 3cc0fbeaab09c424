"""Workers on machines reached by SSH: a real SSH server of this machine, in this process."""

import asyncio
import contextlib
import threading
import time

import pytest
from processes import eventually, job, run
from toys import REPOSITORY

from objectfolder.errors import SimulationError
from pipeline.cluster import ssh_cluster, tls
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import Place, Ssh

asyncssh = pytest.importorskip("asyncssh")


class Server:
    """An SSH server on loopback that runs what it is asked to run."""

    def __init__(self, folder) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        host_key, client_key = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
        self.client_key = folder / "client"
        client_key.write_private_key(self.client_key)
        self._authorized = folder / "authorized"
        client_key.write_public_key(self._authorized)
        self._host_key = host_key
        self.known = folder / "known_hosts"
        self.running: list[asyncio.subprocess.Process] = []
        self.commands: list[str] = []

    def __enter__(self) -> "Server":
        self._thread.start()
        self._server = self._do(self._start())
        self.port = self._server.get_port()
        public = self._host_key.export_public_key().decode()
        self.known.write_text(f"[127.0.0.1]:{self.port} {public}")
        return self

    def __exit__(self, *_: object) -> None:
        self._do(self._end())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def place(self, toys, **settings) -> Place:
        connect = {"port": self.port, "client_keys": [str(self.client_key)], "known_hosts": str(self.known)}
        environment = {"PYTHONPATH": f"{REPOSITORY}:{toys.root}", "GREETING": "it's"}
        hosts = ["someone@127.0.0.1"]
        ssh = Ssh(hosts=hosts, connect=connect, environment=environment)
        return Place(kind="ssh", workers=1, ssh=ssh, **settings)

    def _do(self, coroutine):
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(60)

    async def _start(self):
        return await asyncssh.listen(
            "127.0.0.1",
            0,
            server_host_keys=[self._host_key],
            authorized_client_keys=str(self._authorized),
            process_factory=self._run,
            encoding=None,
        )

    async def _run(self, process) -> None:
        self.commands.append(process.command)
        local = await asyncio.create_subprocess_shell(
            process.command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=-2
        )
        self.running.append(local)
        await process.redirect(stdin=local.stdin, stdout=local.stdout)
        with contextlib.suppress(asyncssh.Error, OSError):
            process.exit(await local.wait())

    async def _end(self) -> None:
        self._server.close()
        for one in self.running:
            if one.returncode is None:
                one.kill()
                await one.wait()


@pytest.fixture
def server(tmp_path):
    with Server(tmp_path) as running:
        yield running


@pytest.mark.slow
def test_workers_over_ssh_with_tls_do_the_work_and_end_with_the_run(toys, server, monkeypatch):
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    with runner(server.place(toys, tls=True), toys.root, 5, (toys.ingest,)) as started:
        body = "poison import os; raise OSError(os.environ['GREETING'])"
        (end,) = run(started, job(toys, "greets", body))
        assert end.worker.startswith("tls://")
        assert end.outcome.failure.error == "OSError: it's"
    assert server.commands == ["sh -s"]  # neither secrets nor certificates stand in a command line
    eventually(lambda: all(one.returncode is not None for one in server.running))


def test_a_machine_that_refuses_is_said_so(toys, server, capsys):
    place = server.place(toys, workers_within_s=20.0)
    server.client_key.write_bytes(asyncssh.generate_private_key("ssh-ed25519").export_private_key())
    with runner(place, toys.root, 5) as started:
        said: list[str] = []

        def told() -> bool:
            said.append(capsys.readouterr().err)
            return "someone@127.0.0.1: Permission denied" in "".join(said)

        eventually(told)
        begun = time.monotonic()
        with pytest.raises(SimulationError, match="no worker for"):
            run(started, job(toys, "good"))
        assert time.monotonic() - begun < 120
    assert "tried again in" in "".join(said)


def test_what_a_machine_is_to_run(tmp_path):
    tls.make(tmp_path / "tls")
    ssh = Ssh(hosts=["a"], python="/opt/my python", folder="/data", environment={"KEY": "a'b"})
    place = Place(kind="ssh", workers=3, memory_gb=2, ssh=ssh)
    text = ssh_cluster.script("tls://head:1", place, tmp_path, tmp_path / "tls")
    assert text.startswith("set -e\ncd /data\nexport KEY='a'\"'\"'b'\n")
    assert "'/opt/my python' -m pipeline.cli worker tls://head:1 --end-with-input --workers 3" in text
    assert "--memory-gb 2" in text
    assert '--tls "$tls"' in text
    for name in tls.FILES:
        assert (tmp_path / "tls" / name).read_text() in text
    assert "tls" not in ssh_cluster.script("tcp://head:1", place, tmp_path, None)
