"""A data set made by several hosts without a shared disk, some of which fail: it comes out the same.

Scheduler, object store, driver and two workers are hosts of their own (`hosts`), with TLS between them.
Each scenario makes objects of its own, and counts what the tasks themselves say of their executions.
"""

import contextlib
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import s3_server
from chaos import Watcher, redone
from ground import PACKAGE, STAGES, Execution, Ground, read_executions, wait_for
from hosts import REPOSITORY, Cable, Host, Network, why_no_cable, why_not
from processes import make_certificate

WORKERS = ("worker-1", "worker-2")
SCHEDULER_PORT, STORE_PORT = 8786, 9000
SILENT_S = 12  # after which the kernel gives a connection up; Dask takes no less than 11
SETTLED_S = 2.0  # after a fault, for what was on its way to begin
OUTAGE_S = 6.0
RETURN_S = 600  # a worker that was cut off while it came up gives up after two minutes, and tries again
ALL_HERE = f"""
import pathlib, sys
from distributed import Client
from pipeline.cluster import tls
with Client(sys.argv[1], security=tls.security_of_file(pathlib.Path("tls.pem")), timeout=60) as client:
    client.wait_for_workers({len(WORKERS)}, timeout={RETURN_S})
"""
CERTIFICATE = [part for name in ("ca-file", "cert", "key") for part in (f"--tls-{name}", "tls.pem")]
POOR = Cable(delay_s=0.1, rate_bit_s=1e6, loss=0.02, seed=3)
GOOD = Cable(delay_s=0.0, rate_bit_s=1e9, loss=0.0)
# Objects of each scenario; all are made once more, here and undisturbed, to compare with.
SCENARIOS = {
    "well": 4, "cut": 6, "again": 4, "killed": 6, "slow": 2, "scheduler": 6, "driver": 6, "store": 6
}  # fmt: skip
CONTENTS = {
    name: {f"{name}_{index}": f"{100 * number + index}.5" for index in range(count)}
    for number, (name, count) in enumerate(SCENARIOS.items())
}

pytestmark = [pytest.mark.slow, pytest.mark.release("pipeline.cluster", "pipeline.store", "cluster")]


class Site:
    """The hosts, and what runs on them for all scenarios."""

    def __init__(self, folder: Path) -> None:
        changeable = () if why_no_cable() else ("worker-2",)
        self.network = Network(folder, ("driver", "scheduler", "store", *WORKERS), changeable)
        self.folder = folder
        self.environment = s3_server.environment(f"http://{self['store'].address}:{STORE_PORT}")
        self.environment |= {
            "OBJECTFOLDER_STORE": "s3://products/data_set",
            "DASK_DISTRIBUTED__COMM__TIMEOUTS__TCP": f"{SILENT_S}s",
        }
        self.certificate = make_certificate(folder / "tls.pem")
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.reference = Ground(
            folder / "reference", {k: v for some in CONTENTS.values() for k, v in some.items()}
        )

    def __getitem__(self, name: str) -> Host:
        return self.network[name]

    @property
    def address(self) -> str:
        return f"tls://{self['scheduler'].address}:{SCHEDULER_PORT}"

    def start(self) -> None:
        for host in self.network.hosts.values():
            shutil.copy(self.certificate, host.folder)
        store = self["store"]
        server = (str(Path(s3_server.__file__)), store.address, str(STORE_PORT))
        store.python(*server, environment=self.environment)
        bucket = "import boto3; boto3.client('s3', region_name='us-east-1').create_bucket(Bucket='products')"
        wait_for(
            lambda: self["driver"].python("-c", bucket, environment=self.environment).wait() == 0,
            "the store answers",
        )
        self.start_scheduler()
        for name in WORKERS:
            shutil.copytree(self.reference.root / PACKAGE, self[name].folder / PACKAGE)
            self.start_worker(name)

    def start_scheduler(self) -> None:
        self.scheduler = self["scheduler"].python(
            *("-m", "dask", "scheduler", *CERTIFICATE, "--dashboard-address", "127.0.0.1:0"),
            *("--host", self["scheduler"].address, "--port", str(SCHEDULER_PORT)),
            environment=self.environment,
        )

    def start_worker(self, name: str) -> None:
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        self[name].start(
            *(str(REPOSITORY / "cluster" / "worker.sh"), self.address, *CERTIFICATE, "--nthreads", "1"),
            environment={**self.environment, "PATIENCE": "2", "PATH": path},
        )

    def wait_for_workers(self) -> None:
        """Wait until all are at the scheduler: how soon one returns is Dask's affair and the kernel's."""
        process = self["driver"].python(
            "-c", ALL_HERE, self.address, environment=self.environment, log="asked"
        )
        assert process.wait() == 0, self["driver"].read("asked")

    def close(self) -> None:
        self.network.close()


class Run:
    """The making of a scenario's objects by the driver host, watched."""

    def __init__(self, site: Site, scenario: str) -> None:
        self.site = site
        self.scenario = scenario
        self.ground = Ground(site["driver"].folder / scenario, CONTENTS[scenario])
        place = {"address": site.address, "reconnect_s": 90.0}
        (self.ground.root / "cluster" / "address.yaml").write_text(repr(place))
        self.allowed: set[tuple[str, str]] = set()
        self.watcher = Watcher(self.ground)
        self.process = self.start()

    def start(self) -> subprocess.Popen[bytes]:
        settings = {
            **self.site.environment,
            "OBJECTFOLDER_CLUSTER": self.site.address,
            "OBJECTFOLDER_TLS": str(self.site["driver"].folder / "tls.pem"),
            "PYTHONPATH": self.ground.environment["PYTHONPATH"],
        }
        command = ("env", "-C", str(self.ground.root), sys.executable, "driver.py", STAGES)
        return self.site["driver"].start(*command, environment=settings)

    def executions(self, *hosts: str) -> list[Execution]:
        """Return what began for this scenario, in order, on all workers or on some."""
        executions = [
            execution
            for host in hosts or WORKERS
            for execution in read_executions(self.site[host].folder / "executed.log")
        ]
        mine = [execution for execution in executions if execution.object_id in self.ground.toys.rows]
        return sorted(mine, key=lambda execution: execution.time)

    def wait_until_under_way(self, host: str, count: int = 3) -> None:
        """Wait until a worker is at work and some tasks have begun."""

        def ready() -> bool:
            assert self.process.poll() is None, self.output()
            return len(self.executions()) >= count and bool(self.unfinished(host))

        wait_for(ready, f"{host} is at work")

    def unfinished(self, *hosts: str, since: float = math.inf) -> set[tuple[str, str]]:
        """Return what hosts are at: begun last by a process that lives or began since, not arrived."""
        alive = set(psutil.pids())
        executions = self.executions(*hosts)
        last = {
            execution.pid: execution.work
            for execution in executions
            if execution.pid in alive or execution.time >= since
        }
        return {work for work in last.values() if not self.ground.stands(work)}

    @contextlib.contextmanager
    def fault(self, *hosts: str) -> Iterator[None]:
        """Within it something fails: what these hosts are at, or begin with on the way, may be done again."""
        begun = time.time()
        self.allowed |= self.unfinished(*hosts)
        yield
        deadline = time.monotonic() + SETTLED_S
        while time.monotonic() < deadline:
            self.allowed |= self.unfinished(*hosts, since=begun)
            time.sleep(0.05)

    def finish(self, runs: int = 1) -> None:
        """Wait for the run's end, and run again where that is meant to be needed."""
        for _ in range(runs):
            code = self.process.wait(300)
            if code == 0:
                break
            self.process = self.start()
        assert self.process.wait(300) == 0, self.output()
        counts = Counter(execution.work for execution in self.executions())
        assert set(counts) == self.ground.works
        again = {work: count for work, count in counts.items() if count > 1 + (work in self.allowed)}
        assert again == {}
        assert redone(self.ground, self.executions(), self.watcher.whole_since) == {}
        digests, reference = self.ground.digests(), self.site.reference.digests()
        assert len(digests) == 4 * len(CONTENTS[self.scenario])
        assert {name for name, digest in digests.items() if reference[name] != digest} == set()

    def output(self) -> str:
        return self.site["driver"].read()[-4000:]


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Iterator[Site]:
    if reason := why_not():
        pytest.skip(reason)
    for needed in ("boto3", "moto.server", "obstore"):
        pytest.importorskip(needed)
    hosts = Site(tmp_path_factory.mktemp("site"))
    before = os.environ.get("PATIENCE")
    os.environ["PATIENCE"] = "0"
    sys.path.insert(0, str(hosts.reference.root))
    try:
        hosts.start()
        hosts.reference.toys.flow()
        yield hosts
    finally:
        sys.path.remove(str(hosts.reference.root))
        os.environ.pop("PATIENCE") if before is None else os.environ.update(PATIENCE=before)
        hosts.close()


@pytest.fixture
def make(site) -> Iterator[type]:
    """Start the making of a scenario; at the end nothing half-written was ever seen."""
    with contextlib.ExitStack() as stack:

        def started(scenario: str) -> Run:
            site.wait_for_workers()
            run = Run(site, scenario)
            stack.enter_context(run.watcher)
            runs.append(run)
            return run

        runs: list[Run] = []
        yield started
    for run in runs:
        assert run.watcher.reads >= 4 * len(run.ground.toys.rows)
        assert run.watcher.broken == []


def test_all_well(make):
    run = make("well")
    run.finish()
    assert all(run.executions(name) for name in WORKERS)


def test_worker_host_cut_off_and_back(site, make):
    run = make("cut")
    run.wait_until_under_way("worker-1")
    with run.fault("worker-1"):
        site["worker-1"].cut()
    run.finish()
    site["worker-1"].mend()
    run = make("again")
    run.finish()
    assert run.executions("worker-1")


def test_worker_host_without_power(site, make):
    run = make("killed")
    run.wait_until_under_way("worker-2")
    with run.fault("worker-2"):
        site["worker-2"].kill()
    run.finish()
    site.start_worker("worker-2")


def test_slow_link(site, make):
    if reason := why_no_cable():
        pytest.skip(reason)
    site["worker-2"].spoil(POOR)
    run = make("slow")
    run.finish()
    site["worker-2"].spoil(GOOD)


def test_scheduler_killed_and_restarted_at_its_address(site, make):
    run = make("scheduler")
    run.wait_until_under_way("worker-1")
    with run.fault(*WORKERS):
        site["scheduler"].kill()
    site.start_scheduler()
    run.finish(runs=2)


def test_driver_killed_and_run_again(site, make):
    run = make("driver")
    run.wait_until_under_way("worker-1")
    with run.fault(*WORKERS):
        run.process.send_signal(signal.SIGKILL)
        run.process.wait()
    run.process = run.start()
    run.finish()


def test_store_unreachable_for_a_while(site, make):
    run = make("store")
    run.wait_until_under_way("worker-1")
    with run.fault(*WORKERS):
        site["store"].cut()
        with contextlib.suppress(subprocess.TimeoutExpired):
            run.process.wait(OUTAGE_S)
    site["store"].mend()
    run.finish(runs=3)
