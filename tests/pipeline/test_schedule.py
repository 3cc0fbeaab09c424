"""Which job goes where: invariants over random crews and jobs, in virtual time, with the real dispatch."""

from collections import Counter, defaultdict
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.dataset.crew import BLENDER, Job, Slot
from pipeline.dataset.stages import STAGES
from pipeline.run.dispatch import Dispatch
from pipeline.run.forecast.drawn_objects import known_objects
from pipeline.run.forecast.known_costs import packaged_costs
from pipeline.run.forecast.simulated_flow import Work, lower_bound_s, run_flow, run_stage_by_stage
from pipeline.run.forecast.simulation import Absence, SimulatedCrew, call_of, hosts
from pipeline.run.schedule import MOST_PASSED, choose, order

FOLLOWS = {name: stage.follows for name, stage in STAGES.items()}
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


@st.composite
def flows(draw):
    """Objects, slots, memory and absences; one slot of the host with Blender is always there."""
    slots = hosts(draw(st.integers(1, 4)), draw(st.integers(1, 4)))
    slots += [Slot(f"render:{place}", "render", POOL) for place in range(draw(st.integers(1, 3)))]
    memory = {slot.host: draw(st.integers(1, 16)) * GB for slot in slots}
    seconds = st.floats(0.1, 100.0)
    objects = {}
    for index in range(draw(st.integers(1, 12))):
        objects[f"o{index}"] = {
            stage: Work(
                draw(seconds),
                draw(seconds),
                draw(seconds),
                draw(st.integers(0, 20)) * GB,
                POOL if stage == "views" else frozenset(),
            )
            for stage in FOLLOWS
        }
    absences = []
    for slot in slots:
        if slot.name != "render:0" and draw(st.booleans()):
            begin = draw(st.floats(0.0, 200.0))
            absences.append(Absence(slot.name, begin, begin + draw(st.floats(1.0, 100.0))))
    return objects, slots, memory, absences


@settings(max_examples=80, deadline=None)
@given(flows())
def test_every_task_ends_once_where_it_may_run_and_after_those_it_follows(flow):
    objects, slots, memory, absences = flow
    timeline = run_flow(objects, FOLLOWS, slots, memory, absences)
    by_name = {slot.name: slot for slot in slots}
    ended = {}
    for run in timeline.runs:
        if not run.lost:
            key = (run.job.call.request.object_id, run.job.call.stage)
            assert key not in ended
            ended[key] = run
    assert len(ended) == len(objects) * len(FOLLOWS)
    for (object_id, stage), run in ended.items():
        assert run.job.needs <= by_name[run.slot].offers
        assert all(ended[object_id, other].end_s <= run.begin_s for other in FOLLOWS[stage])
    for slot in slots:
        runs = sorted((run.begin_s, run.end_s) for run in timeline.runs if run.slot == slot.name)
        assert all(before[1] <= after[0] for before, after in pairwise(runs))
    for absence in absences:
        inside = [run for run in timeline.runs if run.slot == absence.slot and not run.lost]
        assert not any(run.begin_s < absence.begin_s < run.end_s for run in inside)


@settings(max_examples=80, deadline=None)
@given(flows())
def test_memory_of_a_host_is_never_exceeded_but_by_one_alone_on_the_largest(flow):
    objects, slots, memory, absences = flow
    timeline = run_flow(objects, FOLLOWS, slots, memory, absences)
    host_of = {slot.name: slot.host for slot in slots}
    for host in memory:
        runs = [run for run in timeline.runs if host_of[run.slot] == host and run.end_s > run.begin_s]
        for moment in {run.begin_s for run in runs}:
            here = [run.job for run in runs if run.begin_s <= moment < run.end_s]
            total = sum(one.memory_bytes for one in here)
            if total > memory[host]:
                assert len(here) == 1
                able = {slot.host for slot in slots if here[0].needs <= slot.offers}
                # Larger hosts may all have been away at that moment.
                there = {
                    slot.host
                    for slot in slots
                    if slot.host in able
                    and not any(a.slot == slot.name and a.begin_s <= moment < a.end_s for a in absences)
                }
                assert memory[host] == max(memory[other] for other in there)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0.1, 100.0), min_size=1, max_size=60), st.integers(1, 16), st.booleans())
def test_grahams_bound_holds_for_a_stage_in_any_order(seconds, slots, listed):
    objects = {f"o{index}": {"modes": Work(s, s, s)} for index, s in enumerate(seconds)}
    stage = {"modes": frozenset()}
    timeline = run_flow(objects, stage, hosts(1, slots), in_listed_order=listed)
    bound = lower_bound_s(objects, stage, slots)
    assert bound <= timeline.makespan_s * (1 + 1e-9)
    assert timeline.makespan_s <= (2 - 1 / slots) * bound * (1 + 1e-9)


def test_longest_chain_first_is_close_to_the_bound_and_beats_the_listed_order_and_stage_by_stage():
    """Costs of the scans the package was tried on, as if they were known beforehand."""
    known = known_objects(packaged_costs(), list(STAGES), seed=0)
    objects = {
        name: {stage: Work(cost.cpu_s, cost.cpu_s, cost.cpu_s) for stage, cost in costs.items()}
        for name, costs in known.items()
    }
    for workers in (8, 32):
        slots = hosts(workers // 8, 8)
        bound = lower_bound_s(objects, FOLLOWS, workers)
        flow = run_flow(objects, FOLLOWS, slots).makespan_s
        assert flow <= 1.05 * bound
        assert flow < run_flow(objects, FOLLOWS, slots, in_listed_order=True).makespan_s
        assert flow < run_stage_by_stage(objects, FOLLOWS, slots).makespan_s


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


def test_who_joins_late_gets_work_at_once():
    objects = {f"o{index}": {"modes": Work(10.0, 10.0, 10.0)} for index in range(8)}
    late = [Absence("host1:0", 0.0, 5.0), Absence("host1:1", 0.0, 5.0)]
    timeline = run_flow(objects, {"modes": frozenset()}, hosts(2, 2), absences=late)
    starts = Counter(run.begin_s for run in timeline.runs if run.slot.startswith("host1"))
    assert starts[5.0] == 2
    assert timeline.makespan_s == 25.0
