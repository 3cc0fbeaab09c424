"""Units of tasks on Dask: the same arrays in this process, on one worker, and on two."""

import contextlib
import os
import shutil

import numpy as np
import pytest

from learning.grasping import stability, touch_policy
from learning.grasping.worlds import Worlds
from learning.runs import Objects
from learning.workers import Here, in_processes, joined
from pipeline.cluster.places import Place
from pipeline.sandbox.isolation import GLIBC


def test_local_workers_are_processes_of_one_thread_and_others_stay():
    several = in_processes(Place(kwargs={"n_workers": 2, "threads_per_worker": 3}))
    assert several.kwargs == {"n_workers": 6, "threads_per_worker": 1}
    assert in_processes(Place()).kwargs["n_workers"] >= 1
    for place in (Place(address="tcp://a:1"), Place(class_name="SSHCluster", kwargs={"hosts": ["a", "b"]})):
        assert in_processes(place) is place


def test_workers_keep_the_memory_that_they_free(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "place.yaml"
    place.write_text("kwargs: {n_workers: 1, threads_per_worker: 1}", encoding="utf-8")
    with joined(str(place)) as workers:
        asked = [workers.submit(os.getenv, name) for name in GLIBC]
        assert workers.gather(asked) == list(GLIBC.values())


@pytest.mark.slow
def test_grasps_and_policies_are_the_same_on_any_number_of_workers(unparted_mugs, tmp_path, monkeypatch):
    monkeypatch.setattr(stability, "BATCH", 3)
    monkeypatch.setattr(touch_policy, "BATCH_EPISODES", 3)
    settings = unparted_mugs
    objects, grasps, figures = Objects(settings), [], []
    (tmp_path / "parted").mkdir()
    monkeypatch.chdir(tmp_path / "parted")
    Worlds(objects).part("a")  # of all four, for they have the same file
    for count in range(3):
        folder = tmp_path / str(count)
        shutil.copytree(tmp_path / "parted", folder)
        monkeypatch.chdir(folder)  # where its workers keep what they make
        place = folder / "place.yaml"
        place.write_text(f"kwargs: {{n_workers: {count}, threads_per_worker: 1}}", encoding="utf-8")
        with joined(str(place)) if count else contextlib.nullcontext(Here()) as several:
            grasps.append(stability.grasps_of(objects, settings, several))
            figures.append(touch_policy.evaluate(objects, settings, several))
    for other in (1, 2):
        assert figures[other] == figures[0]
        for name, values in grasps[0].items():
            np.testing.assert_array_equal(grasps[other][name], values)
    assert len(grasps[0]["held"]) == 4 * settings.grasping.grasps
    assert len({image.tobytes() for image in grasps[0]["touch"]}) > settings.grasping.grasps, "batches differ"
