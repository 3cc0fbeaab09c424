"""A worker that would compute other numbers gets no work, and the run says why."""

import contextlib
import dataclasses
import json
import os
import subprocess
import sys

import pytest
from processes import command, scheduler, until
from toys import REPOSITORY

from objectfolder.errors import SimulationError
from pipeline.cluster import cluster
from pipeline.cluster.environment_check import Environment, differences, environment_here, environment_of
from pipeline.cluster.places import Place
from pipeline.dataset.stages import STAGES

HERE = environment_here(["numpy", "scipy"], ["pipeline.tasks.objects"])


def test_an_equal_environment_has_no_difference():
    assert differences(HERE, Environment.from_json(HERE.as_json())) == []
    assert HERE.packages["numpy"][0].isdigit()
    assert len(HERE.code["pipeline.tasks.objects"]) > 3


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"python": "3.9"}, "Python 3.9 instead of {python}"),
        ({"packages": {**HERE.packages, "numpy": "1.0"}}, "numpy 1.0 instead of {numpy}"),
        ({"packages": {"numpy": HERE.packages["numpy"]}}, "scipy absent instead of {scipy}"),
        ({"code": {"pipeline.tasks.objects": {}}}, "no module pipeline.tasks.objects"),
        (
            {
                "code": {
                    "pipeline.tasks.objects": {
                        **HERE.code["pipeline.tasks.objects"],
                        "pipeline.dataset.task": "0",
                    }
                }
            },
            "other code in pipeline.dataset.task",
        ),
    ],
)
def test_what_differs_is_named(change, expected):
    found = dataclasses.replace(HERE, **change)
    assert differences(HERE, found) == [expected.format(python=HERE.python, **HERE.packages)]


def test_many_differing_modules_are_counted():
    changed = {name: "0" for name in HERE.code["pipeline.tasks.objects"]}
    (said,) = differences(HERE, dataclasses.replace(HERE, code={"pipeline.tasks.objects": changed}))
    assert f"and {len(changed) - 3} more" in said


def test_all_stages_are_covered():
    wanted = environment_of(STAGES.values())
    assert {stage.task.partition(":")[0] for stage in STAGES.values()} == set(wanted.code)
    assert {name for stage in STAGES.values() for name in stage.packages} == set(wanted.packages)


def test_the_answer_of_another_process_is_the_same():
    answer = subprocess.run(
        [sys.executable, "-m", "pipeline.cluster.environment_check"],
        input=HERE.as_json(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert differences(HERE, Environment.from_json(answer.stdout)) == []
    assert json.loads(answer.stdout)["packages"] == dict(HERE.packages)


@pytest.mark.slow
def test_a_differing_worker_gets_no_work_and_the_run_says_which_and_why(toys, capsys):
    """One worker has this code; the other sees an older numpy, by a folder of metadata in its path."""
    older = toys.root / "older" / "numpy-1.0.dist-info"
    older.mkdir(parents=True)
    (older / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 1.0\n")
    place = Place(kind="address", pools_within_s=2.0)
    with contextlib.ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(toys.root))
        place = dataclasses.replace(place, address=address)
        path = os.pathsep.join([str(older.parent), str(REPOSITORY), os.environ["PYTHONPATH"]])
        other = stack.enter_context(command(toys.root, "worker", address, "--workers", "1", PYTHONPATH=path))
        stages = (toys.ingest,)
        with (
            cluster.crew(place, toys.root, 3, stages) as running,
            pytest.raises(SimulationError, match=r"no worker may work.*numpy 1\.0 instead of"),
        ):
            until(running, lambda _: running.slots())
        patient = dataclasses.replace(place, pools_within_s=600.0)
        with cluster.crew(patient, toys.root, 3, stages) as running:
            # A late joiner is looked at as well, and this one may work.
            stack.enter_context(command(toys.root, "worker", address, "--workers", "1"))
            until(running, lambda _: running.slots())
            assert len(running.slots()) == 1
        assert other.poll() is None
    said = capsys.readouterr().err
    assert "gets no work: numpy 1.0 instead of" in said
    assert "requirements.lock" in said
