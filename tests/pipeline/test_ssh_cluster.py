"""Workers on machines reached by SSH: by OpenSSH's server, on loopback."""

import getpass
import os
import shutil
import subprocess
from pathlib import Path

import psutil
import pytest
from disturbed import free_port
from processes import eventually, make_certificate
from services import PATH, need

from objectfolder.errors import InputError
from pipeline.cluster.cluster import connect
from pipeline.cluster.places import Place

HOST = "127.0.0.1"
SETTINGS = """
ListenAddress {host}
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/client_key.pub
PidFile none
StrictModes no
UsePAM no
"""


@pytest.fixture
def options(tmp_path):
    """Run a server; yield the options with which it can be reached."""
    pytest.importorskip("asyncssh")
    need("sshd", "ssh-keygen")
    for name in ("host_key", "client_key"):
        command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / name]
        subprocess.run(command, check=True)
    (tmp_path / "sshd_config").write_text(SETTINGS.format(host=HOST, folder=tmp_path))
    if os.getuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # which the service makes elsewhere
    port = free_port()
    key = (tmp_path / "host_key.pub").read_text()
    (tmp_path / "known_hosts").write_text(f"[{HOST}]:{port} {key}")
    program = shutil.which("sshd", path=PATH)
    with open(tmp_path / "sshd.log", "wb") as log:
        server = subprocess.Popen(
            [program, "-D", "-e", "-p", str(port), "-f", tmp_path / "sshd_config"], stderr=log
        )
    eventually(lambda: b"listening" in (tmp_path / "sshd.log").read_bytes())
    yield {
        "port": port,
        "username": getpass.getuser(),
        "client_keys": [str(tmp_path / "client_key")],
        "known_hosts": str(tmp_path / "known_hosts"),
    }
    server.terminate()
    server.wait()


def place(options, hosts, **settings) -> Place:
    kwargs = {"hosts": hosts, "connect_options": options, "scheduler_options": {"host": HOST}}
    return Place(class_name="SSHCluster", kwargs=kwargs, tls="tls.pem", **settings)


def commands(word: str) -> list[str]:
    lines = (" ".join(process.info["cmdline"] or []) for process in psutil.process_iter(["cmdline"]))
    return [line for line in lines if word in line]


@pytest.mark.slow
@pytest.mark.release("pipeline.cluster", "cluster")
def test_workers_over_ssh_work_though_a_machine_cannot_be_reached(options, tmp_path, capfd):
    key = make_certificate(tmp_path / "tls.pem").read_text().splitlines()[1]
    where = place(options, [HOST, HOST, "no-such-machine.invalid"], environment={"GREETING": "it's a secret"})
    with connect(where, tmp_path, 5) as client:
        client.wait_for_workers(1, timeout=120)
        assert client.scheduler.address.startswith(f"tls://{HOST}:")
        assert client.submit(os.getenv, "GREETING").result() == "it's a secret"
        assert len(commands("distributed.cli.dask_spec")) >= 2
        assert not commands("it's a secret")
        assert not commands(key)
        said = []
        for part in ("a worker does not start: ", "worker no-such-machine.invalid-1 did not start"):
            eventually(lambda part=part: said.append(capfd.readouterr().err) or part in "".join(said))
    eventually(lambda: not commands("distributed.cli.dask_spec"))


def test_machines_without_a_certificate_are_not_started(tmp_path):
    pytest.importorskip("asyncssh")
    with (
        pytest.raises(InputError, match=r"tls\.pem: is missing.*openssl req"),
        connect(place({}, [HOST, HOST]), tmp_path, 5),
    ):
        pass
    with (
        pytest.raises(InputError, match="share no certificate"),
        connect(place({}, [HOST, HOST]).model_copy(update={"tls": True}), tmp_path, 5),
    ):
        pass
