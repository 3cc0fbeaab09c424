"""A worker that would compute other numbers gets no work, and the run says why."""

import contextlib
import os
import subprocess
import sys

import pytest
from processes import job, run, running, scheduler, worker
from toys import REPOSITORY

from objectfolder.errors import SimulationError
from pipeline.cluster.cluster import runner
from pipeline.cluster.environment_check import Environment, differences_of, environment_here, environment_of
from pipeline.cluster.places import Place
from pipeline.dataset.stages import STAGES

HERE = environment_here(["numpy", "scipy"], ["objectfolder.making.mesh.walls"])
MODULES = sorted(HERE.code["objectfolder.making.mesh.walls"])
OTHER_CODE = f"other code in {', '.join(MODULES[:3])} and {len(MODULES) - 3} more"


def test_an_equal_environment_has_no_difference():
    assert differences_of(HERE, Environment.model_validate_json(HERE.model_dump_json())) == []
    assert HERE.packages["numpy"][0].isdigit()
    assert len(HERE.code["objectfolder.making.mesh.walls"]) > 3


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"python": "3.9"}, "Python 3.9 instead of {python}"),
        ({"packages": {**HERE.packages, "numpy": "1.0"}}, "numpy 1.0 instead of {numpy}"),
        ({"packages": {"numpy": HERE.packages["numpy"]}}, "scipy absent instead of {scipy}"),
        ({"code": {"objectfolder.making.mesh.walls": {}}}, OTHER_CODE),
        (
            {
                "code": {
                    "objectfolder.making.mesh.walls": {
                        **HERE.code["objectfolder.making.mesh.walls"],
                        "pipeline.dataset.task": "0",
                    }
                }
            },
            "other code in pipeline.dataset.task",
        ),
    ],
)
def test_what_differs_is_named(change, expected):
    environment = HERE.model_copy(update=change)
    assert differences_of(HERE, environment) == [expected.format(python=HERE.python, **HERE.packages)]


def test_all_stages_are_covered():
    environment = environment_of(STAGES.values())
    assert {stage.task.partition(":")[0] for stage in STAGES.values()} == set(environment.code)
    assert {name for stage in STAGES.values() for name in stage.packages} == set(environment.packages)


def test_another_process_of_this_installation_finds_no_difference():
    for environment, said in ((HERE, ""), (HERE.model_copy(update={"python": "2.7"}), "Python 3.")):
        answer = subprocess.run(
            [sys.executable, "-m", "pipeline.cluster.environment_check"],
            input=environment.model_dump_json(),
            capture_output=True,
            text=True,
            check=True,
        )
        assert answer.stdout.strip()[: len(said) or None] == said


@pytest.mark.slow
def test_a_differing_worker_gets_no_work_and_the_run_says_which_and_why(toys, capfd):
    """One worker has this code; one sees an older numpy, by a folder of metadata in its path."""
    older = toys.root / "older" / "numpy-1.0.dist-info"
    older.mkdir(parents=True)
    (older / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 1.0\n")
    with contextlib.ExitStack() as stack:
        address, _ = stack.enter_context(scheduler(toys.root))
        place = Place(address=address, pools_within_s=2.0)
        path = os.pathsep.join([str(older.parent), str(REPOSITORY), os.environ["PYTHONPATH"]])
        process = stack.enter_context(worker(toys.root, address, PYTHONPATH=path))
        with (
            runner(place, toys.root, 3, [toys.ingest]) as started,
            pytest.raises(SimulationError, match=r"no worker may work.*numpy 1\.0 instead of"),
        ):
            run(started, job(toys, "early"))
        patient = place.model_copy(update={"pools_within_s": 600.0})
        with runner(patient, toys.root, 3, [toys.ingest]) as started:
            with running(started, job(toys, "late")) as ends:
                # A late joiner is looked at as well, and this one may work.
                stack.enter_context(worker(toys.root, address))
            assert ends[0].outcome.failure is None
        assert process.poll() is None
    said = capfd.readouterr().err
    assert "gets no work: numpy 1.0 instead of" in said
    assert "requirements.lock" in said


WITHOUT_PROJECT = """
import pickle, sys
sys.modules["pipeline"] = None
print(pickle.loads(sys.stdin.buffer.read())._difference())
"""


@pytest.mark.parametrize(("needed", "said"), [(True, "does not see the data folder /nowhere"), (False, "")])
def test_the_check_runs_where_the_project_is_not_installed(needed, said):
    from distributed.protocol.pickle import dumps

    from pipeline.cluster import dask_runner

    plugin = dask_runner.Admission("name", None, "/nowhere", "/nowhere/marker", needed, None)
    answer = subprocess.run(
        [sys.executable, "-c", WITHOUT_PROJECT], input=dumps(plugin), capture_output=True, check=True
    )
    assert said in answer.stdout.decode()
    assert bool(answer.stdout.strip()) == needed
