"""The loop between jobs and crew: losses, retries, refusals, and work added while it runs."""

from collections import Counter
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_crew import Absence, SimulatedCrew, call_of, hosts

from pipeline.dataset.crew import BLENDER, GPU, Finished, Job, Lost, Slot
from pipeline.run.dispatch import MOST_DEATHS, MOST_LOSSES, Dispatch

GB = 10**9


def job(name, seconds=1.0, memory=GB, needs=frozenset()):
    return Job(call_of("stage", name), seconds, seconds, memory, needs)


def name_of(one: Job) -> str:
    return one.call.request.object_id


class PoisonedCrew(SimulatedCrew):
    """Some jobs kill the process they run in, so often."""

    def __init__(self, deaths: dict[str, int], *settings) -> None:
        super().__init__(*settings)
        self.deaths = Counter(deaths)

    def wait(self) -> Sequence[Finished | Lost]:
        return [self._dies(event) for event in super().wait()]

    def _dies(self, event: Finished | Lost) -> Finished | Lost:
        name = name_of(event.job)
        if isinstance(event, Lost) or not self.deaths[name]:
            return event
        self.deaths[name] -= 1
        return Lost(event.job, event.slot, "its process was killed")


def ends(dispatch: Dispatch) -> dict[str, Finished]:
    found = [event for event in dispatch.events() if isinstance(event, Finished)]
    assert len({name_of(event.job) for event in found}) == len(found)
    return {name_of(event.job): event for event in found}


def test_a_job_whose_process_dies_once_is_tried_again_alone_on_its_host():
    crew = PoisonedCrew({"victim": 1}, hosts(1, 4), {"host0": 8 * GB})
    dispatch = Dispatch(crew)
    for one in (job("victim", 3.0), *(job(f"o{index}", 5.0) for index in range(6))):
        dispatch.add(one)
    found = ends(dispatch)
    assert all(event.outcome.failure is None for event in found.values())
    assert found["victim"].tries == 2
    assert found["victim"].host == "host0"
    again = max((run for run in crew.runs if name_of(run.job) == "victim"), key=lambda run: run.begin_s)
    assert not any(
        run.begin_s < again.end_s and again.begin_s < run.end_s for run in crew.runs if run is not again
    )


def test_a_job_whose_process_always_dies_fails_with_the_reason_and_no_other_does():
    crew = PoisonedCrew({"poison": 99}, hosts(2, 2), {"host0": 8 * GB, "host1": 8 * GB})
    dispatch = Dispatch(crew)
    for one in (job("poison"), *(job(f"o{index}") for index in range(29))):
        dispatch.add(one)
    found = ends(dispatch)
    [poison] = [event for event in found.values() if event.outcome.failure]
    assert name_of(poison.job) == "poison"
    assert "killed" in poison.outcome.failure.error
    assert poison.tries == MOST_DEATHS
    runs = Counter(name_of(run.job) for run in crew.runs)
    assert runs.pop("poison") == MOST_DEATHS
    assert set(runs.values()) == {1}


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.floats(0.5, 20.0), min_size=1, max_size=30),
    st.lists(
        st.tuples(st.integers(0, 5), st.floats(0.0, 100.0), st.floats(0.5, 50.0)), max_size=MOST_LOSSES - 1
    ),
)
def test_workers_that_come_and_go_cost_no_job_its_end(seconds, absences):
    """Losses that are not the job's fault are not counted against it, within reason."""
    slots = hosts(3, 2)
    crew = SimulatedCrew(
        slots,
        {slot.host: 2 * GB for slot in slots},
        absences=[Absence(slots[place].name, begin, begin + length) for place, begin, length in absences],
    )
    dispatch = Dispatch(crew)
    for index, duration in enumerate(seconds):
        dispatch.add(job(f"o{index}", duration))
    found = ends(dispatch)
    assert len(found) == len(seconds)
    assert not any(event.outcome.failure for event in found.values())
    finished = [run for run in crew.runs if not run.lost]
    assert len(finished) == len(seconds)


def test_a_job_that_stands_after_its_slot_was_lost_is_not_run_again():
    slots = hosts(1, 1)
    crew = SimulatedCrew(slots, absences=[Absence(slots[0].name, 0.5, 2.0)])
    dispatch = Dispatch(crew, stands=lambda lost: name_of(lost) == "made")
    dispatch.add(job("made", 1.0))
    found = ends(dispatch)
    assert found["made"].outcome.failure is None
    assert [run.lost for run in crew.runs] == [True]


def test_every_loss_is_told_before_it_is_tried_again():
    slots = hosts(1, 1)
    crew = SimulatedCrew(slots, absences=[Absence(slots[0].name, 0.5, 2.0)])
    dispatch = Dispatch(crew)
    dispatch.add(job("o", 1.0))
    assert [type(event) for event in dispatch.events()] == [Lost, Finished]


def test_a_job_that_no_worker_can_take_is_refused_and_the_rest_goes_on():
    dispatch = Dispatch(SimulatedCrew(hosts(1, 2)))
    for one in (job("render", 9.0, needs=frozenset({BLENDER})), job("plain", 1.0)):
        dispatch.add(one)
    found = ends(dispatch)
    assert found["plain"].outcome.failure is None
    assert "blender" in found["render"].outcome.failure.error
    assert found["render"].outcome.failure.remedy


def test_a_job_waits_for_a_pool_that_is_still_to_join():
    slots = [*hosts(1, 1), Slot("render", "render", frozenset({BLENDER}))]
    dispatch = Dispatch(SimulatedCrew(slots, absences=[Absence("render", 0.0, 50.0)]))
    for one in (job("render", 9.0, needs=frozenset({BLENDER})), job("plain", 1.0)):
        dispatch.add(one)
    assert not any(event.outcome.failure for event in ends(dispatch).values())


def test_needs_that_only_two_workers_together_offer_are_refused():
    slots = [Slot("a", "a", frozenset({BLENDER})), Slot("b", "b", frozenset({GPU}))]
    dispatch = Dispatch(SimulatedCrew(slots))
    dispatch.add(job("both", needs=frozenset({BLENDER, GPU})))
    assert ends(dispatch)["both"].outcome.failure is not None


def test_jobs_added_while_it_runs_are_run_longest_chain_first():
    crew = SimulatedCrew(hosts(1, 1))
    dispatch = Dispatch(crew)
    dispatch.add(job("first"))
    order = []
    for event in dispatch.events():
        order.append(name_of(event.job))
        if order == ["first"]:
            for name, seconds in (("short", 1.0), ("long", 5.0), ("middle", 3.0)):
                dispatch.add(job(name, seconds))
    assert order == ["first", "long", "middle", "short"]


def test_a_crew_that_is_gone_for_good_is_an_error_and_no_endless_wait():
    slots = hosts(1, 1)
    dispatch = Dispatch(SimulatedCrew(slots, absences=[Absence(slots[0].name, 0.5)]))
    dispatch.add(job("o", 1.0))
    with pytest.raises(ValueError, match="nothing runs"):
        ends(dispatch)
