"""Workers in jobs of Slurm: of a real one where it runs, and of stand-ins for its commands everywhere.

The stand-ins run a job's script at once on this machine and end it when told; they have no queue and
hold no job to its memory.
"""

import os
import shutil
import subprocess
from pathlib import Path

import psutil
import pytest
from processes import eventually, job, run
from toys import REPOSITORY

from objectfolder.errors import SimulationError
from pipeline.cluster import slurm_cluster, tls
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import Place, Slurm

pytest.importorskip("dask_jobqueue")

SBATCH = """#!/bin/sh
# Stands in for Slurm: runs the script at once.
[ "$1" = --test-only ] && exit 0
folder=$(dirname "$0"); number=$(($(ls "$folder"/*.job 2>/dev/null | wc -l) + 1))
eval "script=\\${$#}"
cp "$script" "$folder/$number.job"
SLURM_JOB_ID=$number setsid sh "$folder/$number.job" > "$folder/$number.out" 2>&1 < /dev/null &
echo $! > "$folder/$number.pid"
echo "Submitted batch job $number"
"""
SCANCEL = """#!/bin/sh
# Stands in for Slurm: ends the process group of a job.
folder=$(dirname "$0")
for number in "$@"; do kill -TERM -- "-$(cat "$folder/$number.pid")"; done
"""
REFUSES = """#!/bin/sh
echo "sbatch: error: Batch job submission failed: Invalid account" >&2
exit 1
"""


def place(memory_gb: float = 1.0, **settings) -> Place:
    path = os.pathsep.join([str(REPOSITORY), os.environ.get("PYTHONPATH", "")])
    slurm = Slurm(
        jobs=1, cores=1, memory_gb=memory_gb, walltime="00:10:00", prologue=[f"export PYTHONPATH={path}"]
    )
    return Place(kind="slurm", slurm=slurm, **settings)


def commands(folder: Path, **scripts: str) -> str:
    """Write stand-ins; return a PATH that finds them first."""
    folder.mkdir()
    for name, content in scripts.items():
        (folder / name).write_text(content)
        (folder / name).chmod(0o755)
    return os.pathsep.join([str(folder), os.environ["PATH"]])


def work(toys, where: Place) -> None:
    with runner(where, toys.root, 5, (toys.ingest,)) as started:
        (end,) = run(started, job(toys, "good"))
        assert started.largest_bytes() == pytest.approx(0.9e9)  # of the job, not of its node
    assert end.outcome.failure is None
    assert toys.executed() == ["ingest good"]


def _answers() -> bool:
    return bool(shutil.which("sinfo")) and not subprocess.run(["sinfo"], capture_output=True).returncode


@pytest.mark.slow
@pytest.mark.skipif(not _answers(), reason="no Slurm runs here")
def test_with_slurm_itself(toys):
    work(toys, place())
    eventually(lambda: not subprocess.run(["squeue", "-h"], capture_output=True, text=True).stdout)


@pytest.mark.slow
def test_with_stand_ins_for_its_commands_and_tls(toys, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", commands(tmp_path / "bin", sbatch=SBATCH, scancel=SCANCEL))
    monkeypatch.delenv("OBJECTFOLDER_TLS", raising=False)
    work(toys, place(tls=True))
    (pid,) = (int(path.read_text()) for path in (tmp_path / "bin").glob("*.pid"))
    eventually(lambda: not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE)


def test_a_job_that_slurm_refuses_ends_the_run_with_its_words(toys, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", commands(tmp_path / "bin", sbatch=REFUSES, scancel=SCANCEL))
    with pytest.raises(SimulationError, match="Invalid account"), runner(place(), toys.root, 5):
        pass


def test_without_slurm_the_run_says_where_to_go(toys, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SimulationError, match="login node"), runner(place(), toys.root, 5):
        pass


def test_the_script_of_a_job(tmp_path):
    from dask_jobqueue.slurm import SLURMJob

    tls.make(tmp_path / "tls")
    slurm = Slurm(
        cores=4,
        memory_gb=8,
        partition="long",
        account="lab",
        directives=["--gres=gpu:1"],
        prologue=["module load python"],
        python="/opt/python",
    )
    where = Place(kind="slurm", workers=2, listen=None, slurm=slurm)
    settings = slurm_cluster.options(where, tmp_path, tls.security(tmp_path / "tls"))
    for name in ("scheduler_options", "silence_logs"):
        del settings[name]
    script = SLURMJob("tls://head:1", "name", **settings).job_script()
    for line in ("-p long", "-A lab", "--cpus-per-task=4", "--mem=8G", "-t 24:00:00", "--gres=gpu:1"):
        assert f"#SBATCH {line}\n" in script
    assert f"cd {tmp_path}\n" in script
    assert "OBJECTFOLDER_WORKER_MEMORY_GB=7.2\n" in script
    assert script.index("module load python") < script.index(
        "/opt/python -m distributed.cli.dask_worker tls://"
    )
    for option in ("--nworkers 2", "--nthreads 2", "--protocol tls://", "--tls-ca-file", "--no-dashboard"):
        assert option in script
