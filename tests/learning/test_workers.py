"""Units of tasks on Dask: the same arrays in this process and on two workers."""

import contextlib
import os
import shutil

import numpy as np
import pytest

from learning.dask_workers import in_processes, joined
from learning.encoders import drawn
from learning.grasping import policy_comparison, stability, touch_policy
from learning.grasping.worlds import Worlds
from learning.runs import Objects
from learning.workers import Here
from pipeline.cluster.places import Place
from pipeline.sandbox.isolation import GLIBC


def test_local_workers_are_processes_of_one_thread_and_others_stay():
    several = in_processes(Place(kwargs={"n_workers": 2, "threads_per_worker": 3}))
    assert several.kwargs == {"n_workers": 6, "threads_per_worker": 1}
    assert in_processes(Place()).kwargs["n_workers"] >= 1
    for place in (Place(address="tcp://a:1"), Place(class_name="SSHCluster", kwargs={"hosts": ["a", "b"]})):
        assert in_processes(place) is place


@pytest.mark.release("learning", "pipeline.cluster")
def test_a_worker_draws_what_this_process_draws_and_keeps_the_memory_that_it_frees(
    tiny, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    place, objects = tmp_path / "place.yaml", Objects(tiny)
    place.write_text("kwargs: {n_workers: 1, threads_per_worker: 1}", encoding="utf-8")
    unit = drawn, objects, tiny, "audio", "sample", 0
    with joined(str(place)) as worker:
        variables, (worker_splits, worker_nearest) = worker.gather(
            [[worker.submit(os.getenv, name) for name in GLIBC], worker.submit(*unit)]
        )
    assert variables == list(GLIBC.values())
    splits, nearest = Here().submit(*unit)
    assert worker_nearest == nearest
    for split, part in splits.items():
        np.testing.assert_array_equal(part.inputs, worker_splits[split].inputs)


@pytest.mark.release("learning")
def test_grasps_and_policies_are_the_same_on_any_number_of_workers(bars, tmp_path, monkeypatch):
    monkeypatch.setattr(stability, "BATCH", 3)
    monkeypatch.setattr(touch_policy, "BATCH_EPISODES", 3)
    monkeypatch.setattr(policy_comparison, "FIXED_MOVES", policy_comparison.FIXED_MOVES[:2])
    monkeypatch.setattr(policy_comparison, "folds_of", lambda objects, settings: [[0, 2], [1, 3]])
    objects, results = Objects(bars), []
    (tmp_path / "parted").mkdir()
    monkeypatch.chdir(tmp_path / "parted")
    Worlds(objects).part("a")  # of all four, for they have the same file
    for count in (0, 2):
        folder = tmp_path / str(count)
        shutil.copytree(tmp_path / "parted", folder)
        monkeypatch.chdir(folder)  # where its workers keep what they make
        place = folder / "place.yaml"
        place.write_text(f"kwargs: {{n_workers: {count}, threads_per_worker: 1}}", encoding="utf-8")
        with joined(str(place)) if count else contextlib.nullcontext(Here()) as several:
            grasps = stability.grasps_of(objects, bars, several)
            results.append((grasps, policy_comparison.evaluate(objects, bars, several)))
    (grasps, figures), (other_grasps, other_figures) = results
    assert other_figures == figures
    for name, values in grasps.items():
        np.testing.assert_array_equal(other_grasps[name], values)
    assert len(grasps["held"]) == 4 * bars.grasping.grasps
    assert len({image.tobytes() for image in grasps["touch"]}) > bars.grasping.grasps, "batches differ"
