"""The live page in a real browser: what it shows is what the Object File answers."""

import numpy as np
import pytest

import objectfolder
from tests.viewer.live_servers import FINEST, served
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


@pytest.fixture(scope="module")
def address(small_file):
    with served(small_file) as server:
        yield server.address


@pytest.fixture
def live(address, open_page):
    watched = open_page(address, viewport={"width": 700, "height": 700})
    drawn(watched.page)
    yield watched
    assert watched.errors == []
    assert watched.left_the_machine == []


def drawn(page):
    """Wait for the first image; the finest takes most of a test's time, and few look at it."""
    page.locator(".player-resolution", has_text="\u00d7").wait_for()


def at_rest(page):
    page.wait_for_selector(".player-image[data-state=rest]")


def test_the_image_is_the_files_own(live, small_file):
    at_rest(live.page)
    first = pixels(live.page)
    assert first.shape[0] == FINEST
    assert (first.max(axis=2) < 13).sum() < 0.1 * (first < 250).any(axis=2).sum(), "lit as opened"
    assert np.array_equal(first, python_answers(live.page)["image"])
    drag(live.page, 0.2)
    at_rest(live.page)
    second = pixels(live.page)
    assert (first != second).any()
    assert np.array_equal(second, python_answers(live.page)["image"])
    live.page.get_by_role("radio", name="Window").check()
    at_rest(live.page)
    assert (pixels(live.page) != second).any()
    assert np.array_equal(pixels(live.page), python_answers(live.page)["image"])
    live.page.get_by_role("radio", name="One lamp").check()
    live.page.get_by_label("Lamp, round").fill("60")
    live.page.get_by_label("Lamp, round").dispatch_event("change")
    at_rest(live.page)
    third = pixels(live.page)
    assert (third != second).any()
    assert np.array_equal(third, python_answers(live.page)["image"])


def test_dragging_shows_coarse_images_at_once(live):
    at_rest(live.page)
    live.page.evaluate(
        """() => { window.drawn = []; document.addEventListener('player:drawn',
        ({ detail }) => window.drawn.push(detail)); }"""
    )
    drag(live.page, 0.3)
    at_rest(live.page)
    images = live.page.evaluate("() => window.drawn")
    assert images[0]["sub_rays"] == 4
    assert images[-1]["sub_rays"] is None
    assert images[-1]["resolution"] == FINEST


def test_a_click_strikes_and_the_python_gives_the_same_sound(live, small_file):
    page = live.page
    answer = touched(page, "struck", lambda: click(page, 0.55, 0.5))
    file = objectfolder.load(small_file)
    ray = evaluated(page, "panel.last.hit.orbit.ray(panel.last.hit.x, panel.last.hit.y)")
    hits = file.surface.ray_hits(np.array([ray["origin"]]), np.array([ray["direction"]]))
    assert np.array_equal(answer["point"], file.surface.points_at(hits.face, hits.barycentric)[0])
    expected = python_answers(page, image=False)
    played = np.array(evaluated(page, "Array.from(panel.heard.buffer.getChannelData(0))"))
    assert np.abs(expected["sound"]).max() > 0
    assert np.array_equal(played.astype(np.float32), expected["sound"])
    assert np.allclose(answer["amplitudes"], expected["amplitudes"], rtol=1e-12)
    strongest = np.argsort(-np.abs(expected["amplitudes"]) / file.modes.dampings_per_s)[:5]
    frequencies = file.modes.frequencies_hz[strongest]
    peaks_hz, _ = spectral_peaks(played, evaluated(page, "panel.last.strike.sample_rate"), frequencies)
    assert np.abs(1200 * np.log2(peaks_hz / frequencies)).max() < 1
    shown = page.locator(".player-answer tbody tr td:first-child").first.text_content()
    number, unit = shown.split()
    heard = float(number) * (1000 if unit == "kHz" else 1)
    assert np.abs(file.modes.frequencies_hz - heard).min() < 0.6


def test_a_press_shows_the_packages_touch(live):
    page = live.page
    page.get_by_role("radio", name="Press").check()
    page.get_by_label("Depth").fill("0.8")
    page.get_by_label("Tilt").fill("5")
    page.get_by_label("Towards").fill("90")
    answer = touched(page, "pressed", lambda: click(page, 0.5, 0.5))
    touch = python_answers(page, image=False)["touch"]
    assert touch.mask.any()
    shown = np.array(page.evaluate(
        """() => { const canvas = document.querySelector('.player-touch canvas');
        return Array.from(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data); }"""
    ), dtype=np.uint8).reshape(*touch.depth_m.shape[1:], 4)  # fmt: skip
    assert np.array_equal(shown[..., :3], touch.rgb[0])
    assert np.array_equal(np.array(answer["depth"], dtype=np.float32), touch.depth_m[0].ravel())
    assert answer["reachable"] == touch.reachable[0]
    assert "0.80 mm" in page.locator(".player-said").text_content()


def test_the_python_is_copied(live):
    page = live.page
    at_rest(page)  # a finer image changes the resolution that the code names
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.get_by_text("The same in Python").click()
    page.get_by_role("button", name="Copy").click()
    page.get_by_role("button", name="Copied").wait_for()
    assert page.evaluate("() => navigator.clipboard.readText()") == page.locator("code").text_content()


def test_texts_of_strangers_stay_texts(small_file, open_page, tmp_path):
    with served(hostile_copy(small_file, tmp_path / "bar.safetensors")) as server:
        watched = open_page(server.address)
        drawn(watched.page)
        assert watched.page.locator("h1").text_content() == HOSTILE
        assert HOSTILE in watched.page.locator("#credit").text_content()
        assert watched.page.evaluate("() => window.hacked") is None
        assert watched.page.locator("img").count() == 0
        assert watched.errors == []


def test_objects_are_switched(small_file, open_page, tmp_path):
    second_file = hostile_copy(small_file, tmp_path / "other.safetensors")
    with served(small_file, second_file) as server:
        page = open_page(server.address).page
        drawn(page)
        choice = page.locator("#objects")
        assert choice.locator("option").all_text_contents() == [small_file.stem, "other"]
        choice.select_option("other")
        page.wait_for_url("**/?object=1")
        drawn(page)
        assert page.locator("h1").text_content() == HOSTILE
        assert choice.input_value() == "1"
        assert str(second_file) in page.locator("#facts").text_content()


def test_a_server_that_is_gone_is_said(small_file, open_page):
    with served(small_file) as server:
        page = open_page(server.address).page
        at_rest(page)
    click(page)
    page.locator(".player-said", has_text="does not answer").wait_for()


def test_another_page_cannot_ask(live, open_page, address, tmp_path):
    """A page of another origin, in the same browser."""
    (tmp_path / "evil.html").write_text("<!doctype html><title>evil</title>")
    page = open_page(tmp_path / "evil.html").page
    for mode in ("cors", "no-cors"):
        said = page.evaluate(
            """async ([address, mode]) => { try {
            const response = await fetch(address + 'object', { method: 'POST', mode, body: '{}' });
            return response.type + (await response.text());
            } catch (error) { return 'refused'; } }""",
            [address, mode],
        )
        assert said in ("refused", "opaque")


@pytest.mark.parametrize(
    "scheme", ["dark", pytest.param("light", marks=pytest.mark.release("pipeline.publish"))]
)
def test_no_fault_of_accessibility(live, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed").Axe()
    live.page.emulate_media(color_scheme=scheme)
    touched(live.page, "struck", lambda: click(live.page))
    live.page.get_by_text("The same in Python").click()
    faults = axe.run(live.page).response["violations"]
    assert [(fault["id"], [node["html"] for node in fault["nodes"]]) for fault in faults] == []
