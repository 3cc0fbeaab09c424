"""Slurm on one node: munge, the controller and the node's daemon, of Debian, in a folder of their own."""

import contextlib
import getpass
import os
import secrets
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from disturbed import free_port
from services import PATH

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "scancel", "sinfo", "squeue")
START_S = 60.0
SETTINGS = """
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={controller_port}
SlurmdPort={node_port}
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SlurmdParameters=config_overrides
ReturnToService=2
KillWait=5
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=64000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES State=UP
"""


@contextlib.contextmanager
def slurm(folder: Path, cpus: int = 4) -> Iterator[dict[str, str]]:
    """Run Slurm; yield the environment in which its commands find it."""
    for name in ("state", "spool"):
        (folder / name).mkdir()
    folder.chmod(0o755)  # munge looks at it
    key = folder / "munge.key"
    key.write_bytes(secrets.token_bytes(128))
    key.chmod(0o600)
    settings = {"host": socket.gethostname().partition(".")[0], "user": getpass.getuser(), "cpus": cpus}
    ports = {"controller_port": free_port(), "node_port": free_port()}
    configuration = folder / "slurm.conf"
    configuration.write_text(SETTINGS.format(folder=folder, **settings, **ports))
    environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(configuration)}
    munge = ["--key-file", key, "--socket", folder / "munge.socket", "--pid-file", folder / "munge.pid"]
    munge += ["--log-file", folder / "munge.log", "--seed-file", folder / "munge.seed", "--force"]
    commands = [["munged", "--foreground", *munge], ["slurmctld", "-D", "-i"], ["slurmd", "-D"]]
    running: list[subprocess.Popen[bytes]] = []
    try:
        for command in commands:
            with open(folder / f"{command[0]}.out", "wb") as output:
                running.append(
                    subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT)
                )
        deadline = time.monotonic() + START_S
        state = ["sinfo", "--noheader", "--format=%T"]
        while b"idle" not in (said := subprocess.run(state, env=environment, capture_output=True)).stdout:
            if time.monotonic() > deadline:
                logs = "\n".join(path.read_text(errors="replace") for path in folder.glob("*.out"))
                raise RuntimeError(f"Slurm does not start: {said}\n{logs}")
            time.sleep(0.2)
        yield environment
    finally:
        for process in reversed(running):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20)
            process.kill()
            process.wait()
