"""A scene that is played to a video: what is seen and heard in it, and the same bytes for the same seed."""

import shutil

import numpy as np
import pytest

from objectfolder.errors import QueryError
from objectfolder.live.clip import AUDIO_RATE_HZ, beside, recorded, write_clip
from objectfolder.live.sight import SceneImage
from pipeline.cli import main
from tests.live.drop_scenes import drop_scene


@pytest.fixture
def scene(tmp_path):
    return drop_scene(tmp_path, "mug")


def read(path):
    av = pytest.importorskip("av")
    with av.open(str(path)) as file:
        images = np.stack([frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)])
    with av.open(str(path)) as file:
        return images, np.concatenate([frame.to_ndarray()[0] for frame in file.decode(audio=0)])


@pytest.mark.slow
def test_a_dropped_mug_is_seen_to_fall_and_heard_to_hit(scene, capsys):
    clip = scene.with_name("clip.mp4")
    command = ["play", str(scene), "--seconds", "0.5", "--width", "96", "--height", "64", "-o"]
    assert main([*command, str(clip)]) == 0
    assert "collisions" in capsys.readouterr().out
    images, sound = read(clip)
    assert images.shape == (15, 64, 96, 3)
    assert abs(images[0].astype(int) - images[-1]).max() > 60, "it has moved"
    peak = abs(sound).max()
    first = np.flatnonzero(abs(sound) > 0.1 * peak)[0] / AUDIO_RATE_HZ
    assert 0.5 < peak < 0.9
    assert 0.05 < first < 0.3, "silent while it falls"
    again = scene.with_name("again.mp4")
    assert main([*command, str(again)]) == 0
    assert again.read_bytes() == clip.read_bytes()
    assert main([*command, str(again), "--seed", "1", "--overwrite"]) == 0
    assert again.read_bytes() != clip.read_bytes()


def test_an_image_is_of_the_moment_at_which_its_sound_begins():
    class World:
        """A simulation that counts the frames that it has run, and shows and sounds that number."""

        frames = 0

        def image(self, camera_to_world, resolution):
            return SceneImage(np.full((*resolution, 3), self.frames, np.uint8), *[np.zeros(resolution)] * 2)

        def block(self):
            self.frames += 1
            return np.full(3, self.frames - 1.0)

    world = World()
    for number, (image, pressure) in enumerate(recorded(world, world, np.eye(4), 0.1, (2, 2))):
        assert (image == number).all()
        assert (pressure == number).all()
    assert number == 2


def test_frames_and_sound_are_read_as_they_were_written(tmp_path):
    frames = np.full((10, 32, 48, 3), 200, dtype=np.uint8)
    frames[5:] = 40
    tone = 20.0 * np.sin(2 * np.pi * 1000 * np.arange(AUDIO_RATE_HZ // 3) / AUDIO_RATE_HZ)
    peak_pa = write_clip(tmp_path / "a.mp4", zip(frames, tone.reshape(10, -1), strict=True), (32, 48))
    images, sound = read(tmp_path / "a.mp4")
    assert abs(images.astype(int) - frames).max() < 6
    assert peak_pa == pytest.approx(20, rel=1e-4)
    assert abs(sound[4096:10240]).max() == pytest.approx(10 ** (-3 / 20), rel=0.03), "3 dB below full scale"
    spectrum = abs(np.fft.rfft(sound[2048:10240] * np.hanning(8192)))
    assert spectrum.argmax() * AUDIO_RATE_HZ / 8192 == pytest.approx(1000, abs=6)


def test_pictures_stand_at_the_right_one_above_the_other():
    image, upper, lower = (
        np.full((height, width, 3), grey, dtype=np.uint8)
        for height, width, grey in ((6, 4, 1), (2, 3, 2), (4, 3, 3))
    )
    rows = [[1] * 4 + [2] * 3] * 2 + [[1] * 4 + [3] * 3] * 4
    assert beside(image, [upper, lower])[..., 0].tolist() == rows
    with pytest.raises(QueryError, match="6 rows beside pictures of 4"):
        beside(image, [lower])


def test_what_cannot_be_played_is_one_line(scene, tmp_path, capsys):
    with pytest.raises(QueryError, match="even"):
        write_clip(tmp_path / "a.mp4", [], (31, 32))
    assert not (tmp_path / "a.mp4").exists()
    shutil.rmtree(scene.parent / "mug")
    for path in (scene, tmp_path / "none.xml"):
        assert main(["play", str(path), "-o", str(tmp_path / "a.mp4")]) == 1
        said = capsys.readouterr().err
        assert str(path) in said
        assert "Traceback" not in said
