"""Running a single job in a child process of this one: a cluster would take longer to start."""

from collections.abc import Callable, Iterator

from pipeline.cluster.pools import offers_here
from pipeline.dataset.job import Finished, Job, failed
from pipeline.dataset.task import Outcome
from pipeline.sandbox.isolation import Child, ProcessKilled

HERE = "here"
MOST_KILLS = 2


class OneProcess:
    """Runs jobs one after the other in a child process."""

    def __init__(self, child: Child) -> None:
        self._child = child
        self._jobs: list[Job] = []

    def submit(self, job: Job) -> None:
        """Accept a job."""
        self._jobs.append(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator[Finished]:
        """Run the jobs and yield them as they end; one whose process is killed is tried once more."""
        while self._jobs:
            on_workers(1, 1)
            job = self._jobs.pop()
            if missing := sorted(job.needs - set(offers_here())):
                remedy = "Install it, or run on a cluster that has it."
                yield Finished(job, failed(job, f"this machine does not offer {', '.join(missing)}", remedy))
                continue
            outcome, tries = self._run(job)
            yield Finished(job, outcome, HERE, HERE, tries)

    def _run(self, job: Job) -> tuple[Outcome, int]:
        for tries in range(1, MOST_KILLS + 1):
            try:
                return self._child.run(job.call, job.memory_bytes), tries
            except ProcessKilled as error:
                killed = str(error)
        remedy = "Out of memory, most likely: lower the settings of this stage."
        return failed(job, f"{killed}, {MOST_KILLS} times", remedy), MOST_KILLS
