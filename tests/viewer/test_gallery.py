"""The gallery: a folder of pages, opened in a real browser with clicks."""

import io
from pathlib import Path

import axe_playwright_python
import numpy as np
import pytest
from PIL import Image

import objectfolder
from objectfolder.errors import InputError
from pipeline.publish.gallery import site
from pipeline.publish.report.templates import TIMES
from tests.viewer.players import click, python_answers, touched

AXE = Path(axe_playwright_python.__file__).parent / "axe.min.js"
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def gallery(small_file, few_colours, tmp_path_factory):
    """A gallery of one object."""
    root = tmp_path_factory.mktemp("gallery")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(site, "FRAMES", 2)
        patch.setattr(site, "PIXELS", 32)
        summary = site.write_gallery([small_file], root / "site", {}, title="One bar")
    assert summary.objects == ("bar",)
    return root / "site"


def faults(watched):
    """What axe finds, what scripts say, and what leaves the machine or overflows."""
    errors = list(watched.errors)  # axe reads style sheets by a way that a page from disk has not
    watched.page.add_script_tag(path=str(AXE))
    rules = watched.page.evaluate("axe.run().then(result => result.violations)")
    wide = watched.page.evaluate("document.documentElement.scrollWidth > innerWidth")
    faults = [(rule["id"], rule["nodes"][0]["html"]) for rule in rules]
    return faults, errors, watched.left_the_machine, wide


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_tile_sounds_and_a_finger_feels(gallery, open_page, monkeypatch, scheme):
    first = open_page(gallery / "index.html", viewport=PHONE, color_scheme=scheme, bypass_csp=True)
    first.page.get_by_role("button", name="Strike Glass bar").click()
    first.page.wait_for_function("player.ended || player.currentTime > 0")
    assert faults(first) == ([], [], [], False)
    address = first.page.get_by_role("link", name="Glass bar").get_attribute("href")
    opened = open_page(gallery / address, viewport=PHONE, color_scheme=scheme, bypass_csp=True)
    page = opened.page
    page.wait_for_selector(".player-side")
    page.wait_for_function("document.querySelector('.player-image').width > 150")
    page.get_by_role("radio", name="Press").check(force=True)
    touched(page, "pressed", lambda: click(page))
    canvas = page.locator(".player-touch canvas")
    assert canvas.bounding_box()["y"] < PHONE["height"], "beside the finger, not below the page"
    shown = np.array(page.evaluate(
        "() => { const it = document.querySelector('.player-touch canvas');"
        " return [...it.getContext('2d').getImageData(0, 0, it.width, it.height).data] }"
    )).reshape(160, 120, 4)[..., :3]  # fmt: skip
    monkeypatch.chdir(gallery)
    answer = python_answers(page, image=False)["tactile"]
    assert np.abs(shown - answer.astype(int)).mean() < 3, "but for the loss of its compression"
    assert np.abs(answer.astype(int) - answer[0, 0]).mean() > 6, "something is pressed"
    assert faults(opened) == ([], [], [], False)


def test_pages_say_what_the_file_says(gallery, small_file):
    page = (gallery / "objects" / "bar.html").read_text()
    file = objectfolder.load(small_file)
    assert f"{len(file.modes.eigenvalues)} modes" in page
    assert f"120.0 {TIMES} 30.0 {TIMES} 8.0 mm" in page
    assert f"View, PSNR of the foreground {file.fidelity['vision']['psnr_foreground_db']:.1f} dB" in page
    assert (gallery / "data/object_files/bar.safetensors").read_bytes() == small_file.read_bytes()
    with Image.open(io.BytesIO((gallery / "objects" / "bar.webp").read_bytes())) as turning:
        assert turning.size == (2 * 32, 32)


def test_two_objects_of_one_name_are_refused(small_file, tmp_path, monkeypatch):
    monkeypatch.setattr(site, "FRAMES", 1)
    with pytest.raises(InputError, match="bar is there twice"):
        site.write_gallery([small_file, small_file], tmp_path / "site", {}, title="")
    assert not (tmp_path / "site").exists()
