"""What a notebook shows of an Object File."""

import base64
import io
import re
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.io import wavfile

import objectfolder
from objectfolder.notebook import png_bytes


def test_an_image_is_read_as_it_was_written() -> None:
    image = np.random.default_rng(0).integers(0, 256, (5, 7, 3), dtype=np.uint8)
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(png_bytes(image)))), image)


def test_a_notebook_shows_a_picture_a_strike_fidelity_and_licence(small_file: Path) -> None:
    bar = objectfolder.load(small_file)
    shown = bar._repr_html_()
    content = dict(re.findall(r'src="data:([a-z/]+);base64,([^"]+)"', shown))
    with Image.open(io.BytesIO(base64.b64decode(content["image/png"]))) as picture:
        np.testing.assert_array_equal(np.asarray(picture), bar.pictures(1)[0])
    rate, sound = wavfile.read(io.BytesIO(base64.b64decode(content["audio/wav"])))
    assert len(sound) == rate
    assert 0.7 < np.abs(sound).max() < 0.71
    fidelity = bar.description["fidelity"]
    for said in (
        fidelity["vision"]["psnr_foreground_db"],
        fidelity["audio"]["gain_error_db"],
        fidelity["touch"]["psnr_contact_db"],
    ):
        assert f"{said:.1f} dB" in shown
    assert "licence CC0-1.0" in shown
    assert "http" not in shown


def test_names_of_a_file_from_elsewhere_are_text_only(small_file: Path) -> None:
    bar = objectfolder.load(small_file)
    named = {**bar.description["object"], "name": "<script>x</script>"}
    shown = bar.with_description(object=named, fidelity=None)._repr_html_()
    assert "<script" not in shown
    assert "fidelity not measured" in shown


def test_modes_and_touches_show_themselves() -> None:
    mug = objectfolder.example("mug")
    modes = mug.modes._repr_html_()
    assert f"{len(mug.modes.frequencies_hz)} modes" in modes
    fall_s = 3 * np.log(10) / mug.modes.dampings_per_s[0]
    assert f"<td>{mug.modes.frequencies_hz[0]:.1f}<td>{fall_s:.3g}" in modes
    points, _ = mug.sample_contacts(2, seed=0)
    touches = mug.press(points)
    shown = re.findall(r"base64,([^\"]+)", touches._repr_html_())
    assert len(shown) == 2
    with Image.open(io.BytesIO(base64.b64decode(shown[1]))) as picture:
        np.testing.assert_array_equal(np.asarray(picture), touches.rgb[1])


def test_sounds_play_themselves_and_are_arrays_in_all_else() -> None:
    mug = objectfolder.example("mug")
    points, normals = mug.sample_contacts(6, seed=0, reachable=False)
    sounds = mug.strike(points, -normals, duration_s=0.1, sample_rate_hz=8000)
    shown = sounds._repr_html_()
    players = re.findall(r"base64,([^\"]+)", shown)
    assert len(players) == 4
    assert "and 2 more" in shown
    rate, played = wavfile.read(io.BytesIO(base64.b64decode(players[1])))
    assert rate == 8000
    np.testing.assert_allclose(played / np.abs(played).max(), sounds[1] / np.abs(sounds[1]).max(), atol=1e-6)
    assert sounds[1].sample_rate_hz == sounds.copy().sample_rate_hz == 8000
    assert sounds[:, ::2]._repr_html_() is None
    assert type(2 * sounds) is type(np.concatenate([sounds, sounds])) is np.ndarray
    assert isinstance(sounds.max(), np.float32)
    two_ears = mug.strike(points[:1], -normals[:1], 0.1, 8000, listener=[[1.0, 0, 0], [0, 1.0, 0]])
    rate, played = wavfile.read(
        io.BytesIO(base64.b64decode(two_ears._repr_html_().split("base64,")[1].split('"')[0]))
    )
    assert played.shape == (800, 2)
