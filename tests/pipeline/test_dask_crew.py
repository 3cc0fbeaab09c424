"""A crew of Dask workers: jobs end where they were put; workers and schedulers may go and come."""

import time

from toys import Toys

from pipeline.cluster import crew
from pipeline.crew import Finished, Job
from pipeline.dask_crew import DaskCrew
from pipeline.places import Place
from pipeline.task import Call, Request

LIMIT_S = 120.0


def job(toys: Toys, name: str, body: str = "1.0", needs: frozenset[str] = frozenset()) -> Job:
    toys.add(name, body)
    request = Request(name, {"mesh": toys.rows[name]["mesh"]}, {}, {}, 0)
    call = Call("ingest", toys.ingest.task, request, toys.ingest.targets(toys.root, name), "0" * 64, {})
    return Job(call, needs=needs)


def until(running: DaskCrew, wanted, limit_s: float = LIMIT_S) -> list:
    """Wait with the crew until `wanted(events so far)`; return the events."""
    events: list = []
    deadline = time.monotonic() + limit_s
    while not wanted(events):
        assert time.monotonic() < deadline, events
        events.extend(running.wait())
    return events


def test_jobs_end_in_the_slots_they_were_put(toys):
    with crew(Place(workers=2), toys.root, 4) as running:
        until(running, lambda _: len(running.slots()) == 2)
        names = sorted(running.slots())
        assert len({slot.host for slot in running.slots().values()}) == 1
        assert min(running.memory_bytes().values()) > 1e8
        jobs = {
            name: job(toys, f"object_{index}", f"poison raise OSError('pid {index}')" if index else "1.0")
            for index, name in enumerate(names)
        }
        for name, one in jobs.items():
            running.start(one, name)
        ends = until(running, lambda events: len(events) == 2)
    assert all(isinstance(end, Finished) for end in ends)
    assert {end.slot: end.job for end in ends} == jobs
    assert [end.outcome.failure is None for end in sorted(ends, key=lambda end: end.slot)] == [True, False]
    assert toys.executed() == ["ingest object_0", "ingest object_1"]
