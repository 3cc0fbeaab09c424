"""The player of a page from disk, in a real browser with clicks."""

import shutil

import numpy as np
import pytest
from PIL import Image
from scipy.io import wavfile

import objectfolder
from pipeline.publish.viewer.static import write_player, write_player_assets
from tests.viewer.players import (
    HOSTILE,
    click,
    drag,
    evaluated,
    hostile_copy,
    pixels,
    python_answers,
    spectral_peaks,
    touched,
)

PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>Objects</title>
<link rel="stylesheet" href="files/player.css"><script src="files/player.js" defer></script>
<main><h1>An object</h1>
<div class="player" data-object="bar" data-script="files/bar.player.js"></div></main></html>"""


@pytest.fixture(scope="module")
def folder(small_file, few_colours, tmp_path_factory):
    """A published report of one object, beside its Object File."""
    root = tmp_path_factory.mktemp("report")
    write_player_assets(root / "files")
    write_player(small_file, root / "files", "bar")
    (root / "data" / "object_files").mkdir(parents=True)
    shutil.copy(small_file, root / "data" / "object_files" / "bar.safetensors")
    (root / "index.html").write_text(PAGE)
    return root


@pytest.fixture
def player(folder, open_page, monkeypatch):
    """The page with its player started; Python of the page runs beside the data."""
    monkeypatch.chdir(folder)
    watched = open_page(folder / "index.html", viewport={"width": 700, "height": 700})
    watched.page.wait_for_selector(".player-side")
    watched.page.wait_for_function("document.querySelector('.player-image').width > 150")
    yield watched
    assert watched.errors == []
    assert watched.left_the_machine == []


def test_drag_keys_zoom_and_lamp_change_the_image(player):
    page = player.page
    images = [pixels(page)]

    def changed(act):
        act()
        page.wait_for_function(f"document.querySelector('.player-image').width == {len(images[0])}")
        images.append(pixels(page))
        assert (images[-1] != images[-2]).any()

    changed(lambda: drag(page, 0.2))
    assert evaluated(page, "panel.orbit.azimuth") == pytest.approx(-96, abs=0.5)
    changed(lambda: drag(page, 0.2, shift=True))
    assert evaluated(page, "panel.orbit.lamp.across") == pytest.approx(16, abs=0.5)
    page.locator(".player-image").focus()
    changed(lambda: page.keyboard.press("ArrowUp"))
    changed(lambda: page.keyboard.press("Shift+ArrowLeft"))
    changed(lambda: page.keyboard.press("+"))
    changed(lambda: page.mouse.wheel(0, 100))
    changed(lambda: page.get_by_label("Lamp, up").fill("80"))
    page.get_by_label("View as at first").click()
    assert (pixels(page) == images[0]).all(), "in the studio again"


def test_a_slow_page_draws_coarser_views_while_something_moves(player):
    def sides(took):
        return evaluated(
            player.page,
            "(() => { const { drawing } = panel.object; drawing.share = 1;"
            f"{took}.forEach((ms) => drawing.keepUp(ms));"
            "return [true, false].map((moving) => drawing.draw(panel.orbit, moving)); })()",
        )

    full = len(pixels(player.page))
    assert sides([10]) == [full, full]
    assert sides([100]) == [pytest.approx(full / 2, abs=1), full]
    assert sides([100, 100, 100]) == [pytest.approx(full / 4, abs=1), full]
    assert sides([100, 1]) == [full, full]


def test_the_studio_shows_all_sides_and_one_lamp_one(player):
    page = player.page
    dark = []
    for light in ("Studio", "Window", "One lamp"):
        page.get_by_role("radio", name=light).check()
        image = pixels(page)[..., :3].max(axis=-1)
        dark.append((image[image < 250] < 40).mean())
    assert evaluated(page, "panel.orbit.lightPosition()") is not None
    assert max(dark[:2]) < 0.1 < dark[2] + 0.1


@pytest.mark.parametrize("light", ["Studio", "Window"])
def test_the_object_is_as_bright_as_in_the_packages_pictures(player, light):
    player.page.get_by_role("radio", name=light).check()
    picture, shown = pixels(player.page), python_answers(player.page, pixels="96")["image"]
    levels = [image[(image < 250).any(axis=2)].mean() for image in (picture, shown)]
    assert levels[0] == pytest.approx(levels[1], rel=0.25)


def test_the_silhouette_is_the_packages(player, folder):
    file = objectfolder.load("data/object_files/bar.safetensors")
    for _ in range(2):
        silhouette = (pixels(player.page) < 255).any(axis=2)
        camera = np.array(evaluated(player.page, "panel.orbit.cameraToWorld()"))
        mask = file.render_passes(camera, ["mask"], resolution=len(silhouette))["mask"][0]
        assert mask.mean() > 0.05
        assert (silhouette & mask).sum() / (silhouette | mask).sum() > 0.97
        drag(player.page, 0.25)


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.5), (0.62, 0.47)])
def test_a_click_strikes_the_nearest_stored_place_and_sounds_as_the_package_does(player, x, y):
    page = player.page
    answer = touched(page, "struck", lambda: click(page, x, y))
    hit = evaluated(page, "({ ...panel.last.hit.orbit.ray(panel.last.hit.x, panel.last.hit.y) })")
    file = objectfolder.load("data/object_files/bar.safetensors")
    hits = file.surface.ray_hits(np.array([hit["origin"]]), np.array([hit["direction"]]))
    clicked = file.surface.points_at(hits.face, hits.barycentric)[0]
    point = np.array(answer["point"])
    places = np.array(evaluated(page, "panel.object.modes.places.map(({ point }) => point)"))
    assert len(places) >= 200
    assert np.linalg.norm(point - clicked) == pytest.approx(np.linalg.norm(places - clicked, axis=1).min())
    # 10 nm and a thousandth of a degree: the surface is stored exactly.
    nearest = file.surface.closest_points(point[None])
    assert np.linalg.norm(point - file.surface.points_at(nearest.face, nearest.barycentric)[0]) < 1e-8
    normal = file.surface.normals_at(nearest.face, nearest.barycentric)[0]
    assert np.array(answer["normal"]) @ normal == pytest.approx(1, abs=1e-9)

    expected = python_answers(page, image=False)
    rate = evaluated(page, "panel.last.strike.sample_rate")
    played = np.array(evaluated(page, "Array.from(panel.heard.buffer.getChannelData(0))"))
    assert len(played) == len(expected["sound"])
    # The same sound but for the gains, which are stored in a byte each: -30 dB.
    assert rms(played - expected["sound"]) < 10 ** (-30 / 20) * rms(expected["sound"])
    amplitudes = np.array(answer["amplitudes"])
    assert rms(amplitudes - expected["amplitudes"]) < 10 ** (-30 / 20) * rms(expected["amplitudes"])
    # And in its spectrum: the strongest partials within 1 cent of the file's modes and 1 dB of their levels.
    strength = np.abs(expected["amplitudes"]) / file.modes.dampings_per_s
    strongest = np.argsort(-strength)[:5]
    strongest = strongest[strength[strongest] > 0.1 * strength.max()]  # others' peaks lie on skirts of these
    frequencies = file.modes.frequencies_hz[strongest]
    peaks_hz, levels = spectral_peaks(played, rate, frequencies)
    _, expected_levels = spectral_peaks(expected["sound"].astype(float), rate, frequencies)
    assert np.abs(1200 * np.log2(peaks_hz / frequencies)).max() < 1
    assert np.abs(levels - expected_levels).max() < 1


def test_strength_scales_the_sound_and_the_direction_is_taken(player):
    page = player.page
    weak = touched(page, "struck", lambda: click(page))
    page.get_by_role("radio", name="Hard 250 mN s").check(force=True)
    strong = touched(page, "struck", lambda: click(page))
    assert np.allclose(np.array(strong["sound"]), 0.25 / 0.05 * np.array(weak["sound"]), rtol=1e-4, atol=1e-6)
    page.get_by_label("Direction").select_option("down")
    down = touched(page, "struck", lambda: click(page))
    assert down["impulse"] == pytest.approx([0, 0, -0.25])


def test_what_is_seen_and_heard_is_saved(player):
    page = player.page
    assert page.get_by_role("button", name="Save sound").is_disabled()
    answer = touched(page, "struck", lambda: click(page))
    with page.expect_download() as saving:
        page.get_by_role("button", name="Save sound").click()
    rate, sound = wavfile.read(saving.value.path())
    assert saving.value.suggested_filename == "bar.wav"
    assert rate == evaluated(page, "panel.last.strike.sample_rate")
    heard = np.array(answer["sound"]) * evaluated(page, "panel.heard.played")
    assert np.abs(sound / 32767 - heard).max() < 1e-4
    assert np.abs(sound).max() > 3000, "at a level that is heard"
    with page.expect_download() as saving:
        page.get_by_role("button", name="Save picture").click()
    with Image.open(saving.value.path()) as picture:
        assert np.array_equal(np.asarray(picture.convert("RGB")), pixels(page))


def test_keys_strike_the_middle_and_a_miss_is_said(player):
    page = player.page
    page.locator(".player-image").focus()
    answer = touched(page, "struck", lambda: page.keyboard.press("Enter"))
    assert evaluated(page, "[panel.last.hit.x, panel.last.hit.y]") == [0.5, 0.5]
    assert len(answer["sound"]) > 44100
    assert "Struck" in page.locator(".player-said").text_content()
    click(page, 0.02, 0.02)
    page.locator(".player-said", has_text="nothing of the object").wait_for()


def test_texts_of_strangers_stay_texts(folder, small_file, open_page, tmp_path):
    file = hostile_copy(small_file, tmp_path / "bar.safetensors")
    write_player_assets(tmp_path / "files")
    write_player(file, tmp_path / "files", "bar")
    (tmp_path / "index.html").write_text(PAGE)
    watched = open_page(tmp_path / "index.html")
    watched.page.wait_for_selector(".player-side")
    assert HOSTILE in watched.page.locator(".player-image").get_attribute("aria-label")
    assert watched.page.evaluate("() => window.hacked") is None
    assert watched.page.locator("img").count() == 0


def test_data_that_is_not_there_is_said(open_page, tmp_path):
    write_player_assets(tmp_path / "files")
    (tmp_path / "index.html").write_text(PAGE)
    watched = open_page(tmp_path / "index.html")
    alert = watched.page.get_by_role("alert")
    alert.wait_for()
    assert "bar.player.js could not be read" in alert.text_content()


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))
