"""Clips of grasps: that what is filmed is what was tried, what is heard and felt in it, and where they go."""

import re
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from learning import page, runs
from learning.grasping import clips
from learning.grasping.clips import clips_in, filmed, write_clips, write_film
from learning.grasping.world import HELD_SHARE, Grasp
from learning.runs import Objects
from objectfolder import example
from objectfolder.live import clip
from objectfolder.live.clip import AUDIO_RATE_HZ

RESULTS = Path(__file__).parents[2] / "learning" / "results"


def read(path):
    av = pytest.importorskip("av")
    with av.open(str(path)) as file:
        images = np.stack([frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)])
    with av.open(str(path)) as file:
        return images.astype(int), np.concatenate([frame.to_ndarray()[0] for frame in file.decode(audio=0)])


@pytest.mark.release("learning.grasping", "objectfolder.live")
def test_a_mug_is_seen_to_rise_heard_to_be_touched_and_felt(held, tmp_path, monkeypatch):
    monkeypatch.setattr(clips, "AFTER_S", 0.1)
    world, grasp = held[0]["mug"], Grasp(0.3, 0.0, 0.0, held[1]["mug"])
    lost = Grasp(0.3, 0.0, 0.0, 0.2 * grasp.force_n)
    for name, grasps, frames_per_s in (("held", [grasp], 10), ("lost", [grasp, lost], 5)):
        for module in (clips, clip):
            monkeypatch.setattr(module, "FRAMES_PER_S", frames_per_s)
        write_film(tmp_path / f"{name}.mp4", world, example("mug"), grasps)
        assert (world.risen_share >= HELD_SHARE) == (name == "held")
    images, sound = read(tmp_path / "held.mp4")
    pixels = 320  # as high as both gels
    assert images.shape[1:] == (pixels, pixels + 120, 3)
    gels = images[:, :, pixels:]
    pressed = abs(gels[4] - gels[0])
    assert pressed.max() > 20, "pressed"
    assert abs(gels[4] - gels[3]).mean() < 0.3 * pressed.mean(), "and held"
    views = images[:, :, :pixels]
    assert abs(views[-1] - views[3]).max() > 100, "lifted"
    loud = np.flatnonzero(abs(sound) > 0.1 * abs(sound).max()) / AUDIO_RATE_HZ
    assert loud[0] < 0.1, "touched at once"
    assert np.median(loud) < 0.3, "then it rings"
    longer, _ = read(tmp_path / "lost.mp4")
    assert 2 * len(longer) > len(images)
    assert abs(longer[-1, :, :pixels] - views[-1]).max() > 100


@pytest.mark.release("learning", "objectfolder.live")
def test_a_film_is_the_same_whatever_was_done_before_it(held):
    world, grasp = held[0]["mug"], Grasp(0.3, 0.01, 0.1, held[1]["mug"])

    def first():
        return list(islice(filmed(world, example("mug"), [grasp]), 3))

    once = first()
    world.close(Grasp(0.0, 0.0, 0.0, grasp.force_n))
    for (image, block), (image_again, block_again) in zip(once, first(), strict=True):
        np.testing.assert_array_equal(image, image_again)
        np.testing.assert_array_equal(block, block_again)
    assert once[2][1].any()


@pytest.mark.slow
def test_what_is_filmed_comes_out_as_its_name_says(mugs, held, tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "RUNS", tmp_path / "runs")
    monkeypatch.setattr(clips, "EACH", 1)
    films = {}
    monkeypatch.setattr(clips, "write_film", lambda path, world, file, grasps: films.update({path: grasps}))
    old = tmp_path / "clips" / "grasping_held_9_z.mp4"
    old.parent.mkdir()
    old.touch()
    paths = write_clips(Objects(mugs), mugs, tmp_path / "clips")
    assert not old.exists()
    assert paths == list(films)
    assert sorted(path.name.rsplit("_", 2)[0] for path in paths) == [
        "grasping_held", "grasping_lost", "regrasping_held", "regrasping_lost",
    ]  # fmt: skip
    world = held[0]["mug"]
    for path, grasps in films.items():
        assert 1 <= len(grasps) <= 1 + 3 * path.name.startswith("regrasping")
        for grasp in grasps:
            world.close(grasp)
        assert (world.lift(grasps[-1].force_n) >= HELD_SHARE) == ("_held_" in path.name)
    again = dict(films)
    assert write_clips(Objects(mugs), mugs, tmp_path / "clips") == paths
    assert films == again
    for path in paths:
        path.touch()
    assert clips_in(tmp_path / "clips")["regrasping"] == sorted(path.name for path in paths[2:])


def test_the_page_shows_the_clips_of_each_task_that_there_are(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(page, "_retrieved", lambda objects, settings: [])
    monkeypatch.setattr(page, "_shapes", lambda objects, settings: [])
    results = tmp_path / "results"
    for task in clips.TASKS:
        for name in (f"{task}.json", f"settings/{task}.json"):
            (results / name).parent.mkdir(parents=True, exist_ok=True)
            (results / name).write_bytes((RESULTS / name).read_bytes())
    (tmp_path / "clips").mkdir()
    for name in ("regrasping_lost_1_a", "grasping_lost_1_b", "grasping_held_1_c"):
        (tmp_path / "clips" / f"{name}.mp4").touch()
    page.write_page(Objects(tiny), tiny, results, tmp_path / "learning.html")
    text = (tmp_path / "learning.html").read_text(encoding="utf-8")
    shown = re.findall(r'src="clips/(\w+)\.mp4"', text)
    assert shown == ["grasping_held_1_c", "grasping_lost_1_b", "regrasping_lost_1_a"]
