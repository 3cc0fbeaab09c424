"""Nothing of a run on this machine can be reached from another one."""

import ipaddress

import psutil
import pytest
from processes import eventually, job

from pipeline.cluster.cluster import runner
from pipeline.cluster.places import read_place


def listening(process: psutil.Process) -> dict[int, set[str]]:
    """The addresses at which a process and its offspring listen, UDP included, by process."""
    addresses: dict[int, set[str]] = {}
    for member in (process, *process.children(recursive=True)):
        for connection in member.net_connections(kind="inet"):
            if connection.status == psutil.CONN_LISTEN or not connection.raddr:
                addresses.setdefault(member.pid, set()).add(connection.laddr.ip)
    return addresses


@pytest.mark.slow
@pytest.mark.parametrize("settings", ["", "tls: false\n"])
def test_a_run_on_this_machine_listens_on_loopback_alone(toys, settings):
    (toys.root / "cluster").mkdir()
    (toys.root / "cluster" / "local.yaml").write_text("kwargs: {threads_per_worker: 2}\n" + settings)
    before = listening(psutil.Process())
    with runner(read_place(toys.root), toys.root, 4) as started:
        for index in range(2):
            started.submit(job(toys, f"still_{index}", "poison import time; time.sleep(600)"))
        log = toys.root / "executed.log"
        eventually(lambda: log.exists() and len(log.read_text().splitlines()) == 2)
        listeners = listening(psutil.Process())
    own = {pid: addresses - before.get(pid, set()) for pid, addresses in listeners.items()}
    assert len([pid for pid, addresses in own.items() if addresses]) >= 2  # the scheduler's and the worker's
    assert all(ipaddress.ip_address(ip).is_loopback for addresses in own.values() for ip in addresses), own
