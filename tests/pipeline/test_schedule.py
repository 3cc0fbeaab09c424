"""Which job goes where, in virtual time, with the real dispatch."""

from collections import defaultdict

import pytest
from simulated_crew import SimulatedCrew, call_of, hosts

from pipeline.dataset.crew import BLENDER, Job, Slot
from pipeline.run.dispatch import Dispatch
from pipeline.run.schedule import MOST_PASSED, choose, order

POOL = frozenset({BLENDER})
GB = 10**9


def job(name, path=1.0, memory=0, needs=frozenset()):
    return Job(call_of("stage", name), path, path, memory, needs)


def waiting(*jobs):
    grouped = defaultdict(list)
    for one in sorted(jobs, key=order):
        grouped[one.needs].append(one)
    return grouped


def names(chosen):
    return [(one.call.request.object_id, slot) for one, slot in chosen]


def test_jobs_that_need_nothing_leave_the_pools_to_those_who_do():
    slots = {slot.name: slot for slot in (Slot("a", "a", POOL), Slot("b", "b"))}
    chosen = choose(waiting(job("plain", 9.0), job("render", 1.0, needs=POOL)), slots, {}, {})
    assert names(chosen) == [("plain", "b"), ("render", "a")]


def test_a_job_goes_to_a_host_that_can_hold_it_even_while_a_smaller_one_is_idle():
    slots = {slot.name: slot for slot in hosts(2, 2)}
    memory = {"host0": 8 * GB, "host1": 16 * GB}
    running = {"host1:0": (job("other", memory=8 * GB), slots["host1:0"])}
    assert choose(waiting(job("large", memory=12 * GB)), slots, running, memory) == []
    # And the host it waits for is held for it, the other is not.
    both = waiting(job("large", 9.0, 12 * GB), job("small", 1.0, 4 * GB))
    assert names(choose(both, slots, running, memory)) == [("small", "host0:0")]


def test_a_job_larger_than_every_host_runs_alone_on_the_largest():
    slots = {slot.name: slot for slot in hosts(2, 2)}
    memory = {"host0": 8 * GB, "host1": 16 * GB}
    jobs = waiting(job("giant", 9.0, 99 * GB), job("small", 1.0, 4 * GB), job("tiny", 0.5, 4 * GB))
    assert names(choose(jobs, slots, {}, memory)) == [
        ("giant", "host1:0"),
        ("small", "host0:0"),
        ("tiny", "host0:1"),
    ]


def test_a_host_whose_memory_is_not_known_yet_is_no_error():
    slots = {slot.name: slot for slot in hosts(1, 1)}
    assert len(choose(waiting(job("one", memory=GB)), slots, {}, {})) == 1


@pytest.mark.parametrize("sizes", [[4], [4, 4], [2, 4]])
def test_a_large_job_waits_no_longer_than_what_ran_when_it_came(sizes):
    """Small jobs never stop coming; the large one needs all of the largest host."""
    slots = [Slot(f"h{host}:{place}", f"h{host}") for host, size in enumerate(sizes) for place in range(size)]
    crew = SimulatedCrew(slots, {f"h{host}": size * GB for host, size in enumerate(sizes)})
    dispatch = Dispatch(crew)
    for index in range(2 * len(slots)):
        dispatch.add(Job(call_of("small", f"s{index}"), 1.0 + index % 7, 5.0, GB))
    came = None
    for count, _ in enumerate(dispatch.events()):
        if count == 1:
            came = crew.now_s
            dispatch.add(Job(call_of("large", "large"), 1.0, 100.0, max(sizes) * GB))
        if count < 300:
            dispatch.add(Job(call_of("small", f"t{count}"), 1.0 + count % 7, 5.0, GB))
    [large] = [run for run in crew.runs if run.job.call.stage == "large"]
    assert large.begin_s <= came + 7.0


def test_the_pools_jobs_do_not_hide_those_behind_them():
    slots = {"a": Slot("a", "a")}
    jobs = [job(f"render{index}", 9.0, needs=POOL) for index in range(5 * MOST_PASSED)]
    assert names(choose(waiting(*jobs, job("plain", 1.0)), slots, {}, {})) == [("plain", "a")]


def test_an_event_looks_at_few_of_the_jobs_that_wait():
    """Counted, not timed: 20,000 that need a pool that is busy, or memory that is taken."""

    class Counted(list):
        looked = 0

        def __getitem__(self, place):
            Counted.looked += 1
            return super().__getitem__(place)

    slots = {slot.name: slot for slot in [*hosts(8, 8), Slot("render", "render", POOL)]}
    memory = {slot.host: 8 * GB for slot in slots.values()}
    running = {name: (job(name, memory=GB), slot) for name, slot in slots.items() if name != "host0:0"}
    many = {
        POOL: Counted(job(f"r{index:05d}", 9.0, needs=POOL) for index in range(10_000)),
        frozenset(): Counted(job(f"m{index:05d}", 5.0, memory=4 * GB) for index in range(10_000)),
    }
    assert choose(many, slots, running, memory) == []
    assert Counted.looked < 50
