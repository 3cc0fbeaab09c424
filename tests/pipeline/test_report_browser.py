"""Pages of a report in a real browser: used by keyboard and mouse, checked for accessibility, watched."""

import base64
import io
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import axe_playwright_python
import numpy as np
import pytest
from fidelity_products import FAILURE, HELD_OUT_STRIKES, write_costs
from PIL import Image
from report_data_sets import HOSTILE, write_object

from objectfolder.fidelity.sound import stored_strike
from objectfolder.products.store import Product, read_product, write_product
from pipeline.publish.report.report import write_report
from tests.patience import wait_until

pytest_plugins = ["tests.browser"]
AXE = Path(axe_playwright_python.__file__).parent / "axe.min.js"
PHONE = {"width": 360, "height": 740}
SIZES = (PHONE, {"width": 390, "height": 800}, {"width": 1280, "height": 900}, {"width": 1920, "height": 900})
# Each page and each scheme once; all pages in all schemes before a release.
sweep = pytest.mark.release("pipeline.publish")
# Elements that hide a part of what they hold; others show it, or scroll to it.
CUT = """[...document.querySelectorAll('main *')].filter(one => one.clientWidth > 2
    && one.scrollWidth > one.clientWidth + 1
    && !['visible', 'auto'].includes(getComputedStyle(one).overflowX))
    .map(one => one.outerHTML.slice(0, 80))"""
# Images outside the window are not loaded before one scrolls to them.
SEEN_IMAGES_COMPLETE = """[...document.images].every(image => {
    const box = image.getBoundingClientRect();
    return image.complete || !box.height || box.bottom < 0 || box.top > innerHeight;
})"""
# More objects than one part of the table holds.
OBJECTS = 54
MATERIALS = ("steel", "glass", "wood")


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The reports of a data set: a few objects with pages that show all, and many that repeat one product."""
    root = tmp_path_factory.mktemp("browser")
    write_object(root / "data", "hostile", text=HOSTILE, shift=4.0)
    write_object(root / "data", "mug")
    fidelity = root / "data" / "fidelity"
    product = read_product(fidelity / "mug.zarr.zip")
    for index in range(OBJECTS - 2):
        described = {**product.attributes["object"], "id": f"o{index}", "name": f"Object {index}"}
        described |= {"material": MATERIALS[index % 3], "source": f"https://host{index % 2}.example/{index}"}
        vision = {**product.attributes["vision"], "psnr_foreground_db": 33.0 + index / 7}
        attributes = {**product.attributes, "object": described, "vision": vision}
        write_product(fidelity / f"o{index}.zarr.zip", Product({}, attributes))
    failure = replace(FAILURE, error=HOSTILE, remedy=HOSTILE)
    write_report(fidelity, write_costs(root / "costs.csv", ["mug"]), root / "reports", [failure], pairs=4)
    return root / "reports"


def until(page: Any, condition: str) -> None:
    """Wait for a condition; Playwright's own way evaluates text in the page, which the page forbids."""
    wait_until(lambda: page.evaluate(condition), condition, pause=lambda s: page.wait_for_timeout(1000 * s))


def names(page: Any) -> list[str]:
    return page.eval_on_selector_all("#table tbody th", "cells => cells.map(cell => cell.innerText.trim())")


def column(page: Any, place: int) -> list[str]:
    script = f"rows => rows.map(row => row.cells[{place}].innerText.trim())"
    return page.eval_on_selector_all("#table tbody tr", script)


def numbers(texts: list[str]) -> list[float]:
    return [float(text.replace("\N{MINUS SIGN}", "-")) for text in texts if text != "\N{EN DASH}"]


@pytest.mark.parametrize(
    ("name", "scheme"),
    [
        ("index.html", "light"),
        ("objects/mug.html", "dark"),
        pytest.param("index.html", "dark", marks=sweep),
        pytest.param("objects/mug.html", "light", marks=sweep),
    ],
)
def test_axe_finds_nothing(reports: Path, open_page: Callable[..., Any], name: str, scheme: str) -> None:
    watched = open_page(reports / name, color_scheme=scheme, bypass_csp=True)
    page = watched.page
    page.evaluate("for (const details of document.querySelectorAll('details')) details.open = true")
    if name == "index.html":
        page.fill("#search", "object 1")  # a dozen rows stand for all
    page.add_script_tag(path=str(AXE))
    violations = page.evaluate("axe.run().then(result => result.violations)")
    assert [(rule["id"], rule["nodes"][0]["html"]) for rule in violations] == []


@pytest.mark.parametrize(
    "name",
    [
        "objects/hostile.html",
        pytest.param("index.html", marks=sweep),
        pytest.param("objects/mug.html", marks=sweep),
    ],
)
def test_nothing_leaves_runs_or_overflows(reports: Path, open_page: Callable[..., Any], name: str) -> None:
    for size in (PHONE, {"width": 1280, "height": 900}):
        watched = open_page(reports / name, viewport=size)
        page = watched.page
        page.evaluate("scrollTo(0, document.body.scrollHeight)")
        until(page, SEEN_IMAGES_COMPLETE)
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
        assert page.evaluate("document.title") != "run"
        assert page.evaluate("[...document.scripts].every(s => !s.textContent.startsWith('document.title'))")
        assert watched.left_the_machine == []
        assert watched.errors == []


@pytest.mark.parametrize("size", [SIZES[0], *(pytest.param(size, marks=sweep) for size in SIZES[1:])])
def test_tiles_and_table_fit_the_page(
    reports: Path, open_page: Callable[..., Any], size: dict[str, int]
) -> None:
    page = open_page(reports / "index.html", viewport=size).page
    page.fill("#search", "object")  # the other one's words are longer than any column
    for _ in range(2):
        assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
        assert page.evaluate(CUT) == []
        page.click("#view")


def test_tiles_and_table_share_order_and_filter(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html", viewport=SIZES[-1]).page
    page.fill("#search", "object")
    page.click("#view")
    page.select_option("#order", "1 descending")
    page.click("#view")
    assert column(page, 1)[0] == "wood"
    page.click("button[type=reset]")
    until(page, "document.querySelector('#table tbody th').innerText.startsWith('<script>document.title')")
    assert page.input_value("#order") == "4 ascending"


def test_the_modal_table_fits_a_phone(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "objects" / "mug.html", viewport=PHONE).page
    width = page.evaluate("(one => [one.scrollWidth, one.clientWidth])(document.querySelector('.tall'))")
    assert width[0] <= width[1]


def test_a_tile_strikes_its_object(reports: Path, open_page: Callable[..., Any]) -> None:
    watched = open_page(reports / "index.html")
    page = watched.page
    page.evaluate("""window.heard = [];
        HTMLMediaElement.prototype.play = function () {
            this.addEventListener('loadedmetadata', () => heard.push([this.src, this.duration]));
            this.load();
        }; undefined""")
    page.fill("#search", "mug")
    page.click(".hear")
    until(page, "heard.length === 1")
    source, duration = page.evaluate("heard[0]")
    assert source.endswith("objects/mug.wav")
    assert 0.1 < duration <= 0.8
    assert watched.errors == []


def test_a_policy_stops_what_would_run(reports: Path, open_page: Callable[..., Any]) -> None:
    """Were markup let through, the browser still would neither run nor fetch it."""
    watched = open_page(reports / "index.html")
    page = watched.page
    page.evaluate("""() => {
        window.ran = false;
        const wrong = document.createElement('div');
        wrong.innerHTML = '<img src="x" onerror="window.ran = true"><img src="https://example.org/x.png">';
        document.body.append(wrong);
    }""")
    until(page, "[...document.querySelectorAll('body > div img')].every(image => image.complete)")
    assert not page.evaluate("window.ran")
    refused = [error for error in watched.errors if "Content Security Policy" in error]
    assert any("example.org" in error for error in refused)
    assert any("inline event handler" in error for error in refused)


def test_the_table_is_sorted_by_its_headers(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html").page
    page.click("#view")
    margins = numbers(column(page, 4))
    assert margins == sorted(margins), "worst first"
    assert names(page)[0].startswith("<script>document.title")
    assert page.get_attribute("#table th:nth-child(5)", "aria-sort") == "ascending"
    page.focus("#table th:nth-child(6) button")
    page.keyboard.press("Enter")
    values = numbers(column(page, 5))
    assert values == sorted(values)
    page.keyboard.press("Space")
    values = numbers(column(page, 5))
    assert values == sorted(values, reverse=True)
    assert page.get_attribute("#table th:nth-child(6)", "aria-sort") == "descending"
    assert page.get_attribute("#table th:nth-child(5)", "aria-sort") is None
    page.click("#table th:nth-child(1) button")
    shown = [name.split("\n")[0] for name in names(page)]
    objects = [int(name.split()[1]) for name in shown if name.startswith("Object")]
    assert objects == sorted(objects), "Object 10 comes after Object 9"


def test_rows_are_shown_in_parts(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html").page
    assert page.inner_text("#found") == f"{OBJECTS + 1} objects"
    first = names(page)
    assert len(first) == 50
    assert page.is_disabled("#before")
    page.click("#after")
    second = names(page)
    assert len(second) == OBJECTS + 1 - 50
    assert second[-1] == "broken", "what failed has no margin"
    assert not set(first) & set(second)
    assert page.inner_text("#where") == f"51 to {OBJECTS + 1} of {OBJECTS + 1}"


def test_search_and_filters_narrow_the_table(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html").page
    page.fill("#search", "object 17")
    assert [name.split("\n")[0] for name in names(page)] == ["Object 17"]
    assert page.inner_text("#found") == f"1 of {OBJECTS + 1} objects"
    page.fill("#search", "<script>")
    assert len(names(page)) == 1
    page.click("button[type=reset]")
    until(page, "document.querySelectorAll('#table tbody tr').length === 50")
    page.select_option("#material", "glass")
    page.select_option("#source", "host1.example")
    assert set(column(page, 1)) == {"glass"}
    assert set(column(page, 2)) == {"host1.example"}
    assert len(names(page)) == len([i for i in range(OBJECTS - 2) if i % 3 == 1 and i % 2 == 1])
    page.click("button[type=reset]")
    until(page, "document.querySelectorAll('#table tbody tr').length === 50")
    page.select_option("#status", "failed")
    assert names(page) == ["broken"]
    assert page.is_hidden("#after")


def test_the_address_has_what_is_shown(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html").page
    assert "#" not in page.url
    page.click("#view")
    page.fill("#search", "object")
    page.select_option("#order", label="Object ↓")
    page.click("#after")
    shown = names(page)
    second_page = open_page(page.url).page
    assert names(second_page) == shown
    assert second_page.get_attribute("#table th:nth-child(1)", "aria-sort") == "descending"
    second_page.evaluate("location.hash = 'search=object+17&material=none&order=x&from=-3'")
    until(second_page, "document.querySelectorAll('#table tbody tr').length === 1")
    assert [name.split("\n")[0] for name in names(second_page)] == ["Object 17"]
    second_page.click("button[type=reset]")
    until(second_page, "!location.href.includes('search')")
    assert second_page.input_value("#material") == ""


def test_the_page_is_as_dark_as_the_system(reports: Path, open_page: Callable[..., Any]) -> None:
    background = "getComputedStyle(document.body).backgroundColor"
    schemes = ("light", "dark")
    pages = [open_page(reports / "index.html", color_scheme=scheme).page for scheme in schemes]
    assert len({page.evaluate(background) for page in pages}) == 2


def test_a_slider_chooses_the_query_by_keyboard(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "objects" / "mug.html").page
    for sense, count in (("view", 8), ("touch", 6)):
        shown = f"[data-sense={sense}] .query:not([hidden])"
        assert page.locator(shown).count() == 1
        assert page.get_attribute(f"#{sense}-query", "aria-valuetext") == f"{count // 2} of {count}"
        page.click(f"[data-sense={sense}] .worst")
        assert page.get_attribute(shown, "data-place") == "worst"
        page.focus(f"#{sense}-query")
        page.keyboard.press("ArrowRight")
        assert page.get_attribute(f"#{sense}-query", "aria-valuetext") == f"2 of {count}"
        page.keyboard.press("End")
        assert page.get_attribute(shown, "data-place") == "best"
        assert page.get_attribute(f"#{sense}-query", "aria-valuetext") == f"{count} of {count}: best"
        assert page.inner_text(f"[data-sense={sense}] output") == f"{count} of {count}: best"


def test_every_query_is_there_and_what_is_not_stored_alone_comes_from_the_sheet(
    reports: Path, open_page: Callable[..., Any]
) -> None:
    product = read_product(reports.parent / "data" / "fidelity" / "mug.zarr.zip")
    watched = open_page(reports / "objects" / "mug.html", viewport=PHONE)
    page = watched.page
    for sense, name, ranks in (("view", "vision", [1, 3, 4, 6]), ("touch", "touch", [1, 4])):
        kind = "view" if sense == "view" else "touch"
        scores = [row["psnr_db"] for row in product.attributes[name][f"per_{kind}"]]
        sheet = Image.open(io.BytesIO(product[f"{name}_sheet"].tobytes())).convert("RGB")
        height, width = product[f"{name}_truth"].shape[1:3]
        page.focus(f"#{sense}-query")
        page.keyboard.press("Home")
        for rank in range(len(scores)):
            if rank in ranks:
                row = int(np.argsort(scores)[rank])
                until(
                    page, f"document.querySelector('[data-sense={sense}] .sheet').dataset.drawn === '{row}'"
                )
                assert page.locator(f"[data-sense={sense}] .query:not([hidden])").count() == 1
                assert page.inner_text(f"[data-sense={sense}] .sheet .row").split()[-2:] != []
                assert f"{max(scores[row], 0):.1f}" in page.inner_text(f"[data-sense={sense}] .sheet .row")
                shown = f"[data-sense={sense}] .sheet canvas"
                assert page.locator(shown).nth(2).is_visible()
            page.keyboard.press("ArrowRight")
        assert sheet.size == (3 * width, height * len(scores))
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert watched.errors == []


def pixels(page: Any, selector: str) -> np.ndarray:
    uri = page.eval_on_selector(selector, "canvas => canvas.toDataURL('image/png')")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))).convert("RGB"))


def test_the_difference_is_that_of_the_stored_pictures(reports: Path, open_page: Callable[..., Any]) -> None:
    product = read_product(reports.parent / "data" / "fidelity" / "mug.zarr.zip")
    page = open_page(reports / "objects" / "mug.html").page
    for sense, name in (("view", "vision"), ("touch", "touch")):
        difference = product[f"{name}_answer"].astype(int) - product[f"{name}_truth"]
        canvas = f"[data-sense={sense}] .query:not([hidden]) canvas"
        page.click(f"[data-sense={sense}] .worst")
        page.wait_for_selector(f"{canvas}[data-factor='8']")
        assert np.array_equal(pixels(page, canvas), np.clip(128 + 8 * difference[0], 0, 255))
        page.select_option(f"[data-sense={sense}] select", "2")
        page.wait_for_selector(f"{canvas}[data-factor='2']")
        assert np.array_equal(pixels(page, canvas), np.clip(128 + 2 * difference[0], 0, 255))
        page.select_option(f"[data-sense={sense}] select", "8")


def test_every_held_out_strike_sounds_as_its_modes_do(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "objects" / "mug.html").page
    slider = page.locator("#strike-query")
    assert slider.get_attribute("max") == str(HELD_OUT_STRIKES)
    query = "document.querySelector('.query.strikes')"
    page.click("[data-sense=strike] .worst")
    until(page, f"{query}.dataset.drawn === '0'")
    fidelity = read_product(reports.parent / "data" / "fidelity" / "mug.zarr.zip")
    modes = read_product(reports.parent / "data" / "modes" / "mug.zarr.zip")
    points_mm = 1e3 * modes["points"][modes["held_out"]]
    pictured = f"[...{query}.querySelectorAll('image')].map((one) => one.getAttribute('href'))"
    pictures = []
    for rank, row in enumerate(np.argsort(-fidelity["strike_difference_db"])):
        slider.fill(str(rank + 1))
        until(page, f"{query}.dataset.drawn === '{rank}'")
        pictures.append(page.evaluate(pictured))
        sounds = page.evaluate(
            f"[...{query}.querySelectorAll('audio')].map(({{ sound }}) => [...sound.subarray(0, 40000)])"
        )
        stored = [stored_strike(fidelity, which, int(row))[:40000] for which in range(2)]
        # Both times one factor, by which the louder has a peak of .9.
        np.testing.assert_allclose(sounds, np.multiply(stored, 0.9 / np.abs(stored).max()), atol=1e-6)
        said = page.inner_text(".query.strikes .row").replace("\N{MINUS SIGN}", "-")
        assert f"impulse along {'xyz'[row % 3]}" in said
        place = re.findall(r"\b[xyz] (-?[\d.]+) mm", said.replace("\n", " "))
        np.testing.assert_allclose(list(map(float, place)), points_mm[row], atol=0.051)
    assert (
        page.locator("[data-sense=strike] output").first.text_content()
        == f"{HELD_OUT_STRIKES} of {HELD_OUT_STRIKES}: best"
    )
    assert len({hrefs[2] for hrefs in pictures}) == HELD_OUT_STRIKES, "each difference is another"


def test_a_page_says_that_its_strikes_are_not_beside_it(
    reports: Path, open_page: Callable[..., Any], tmp_path: Path
) -> None:
    shutil.copy(reports / "objects" / "mug.html", tmp_path / "mug.html")
    page = open_page(tmp_path / "mug.html").page
    until(page, "document.querySelector('.query.strikes .row').textContent !== ''")
    assert page.inner_text(".query.strikes .row") == "mug.strikes.js beside this page could not be read."


def test_a_button_plays_its_sound_and_stops_the_other(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "objects" / "mug.html").page
    buttons = page.locator("[data-sense=strike] .query:not([hidden]) button.play")
    assert buttons.count() == 2
    sounds = "[...document.querySelectorAll('.query:not([hidden]) audio')]"
    page.evaluate(f"""window.played = [];
        {sounds}.forEach((audio, i) => audio.addEventListener('playing', () => played.push(i)))""")
    buttons.nth(0).click()
    until(page, "played.length === 1")
    buttons.nth(1).focus()
    page.keyboard.press("Enter")
    until(page, "played.length === 2")
    assert page.evaluate("played") == [0, 1]
    until(page, f"{sounds}.every(audio => audio.paused || audio === {sounds}[1])")
    assert page.evaluate(f"{sounds}[1].duration") == pytest.approx(1.0, abs=0.6)
    until(page, f"{sounds}[1].ended")
    assert buttons.nth(1).get_attribute("aria-pressed") == "false"


def test_the_first_key_skips_to_the_content(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "index.html").page
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "content"


def test_an_object_leads_to_its_neighbour_and_back(reports: Path, open_page: Callable[..., Any]) -> None:
    page = open_page(reports / "objects" / "mug.html").page
    page.click("a[rel=next]")
    page.wait_for_url("**/o0.html")
    page.click("text=All objects")
    page.wait_for_url("**/index.html")
    page.click("#table tbody th a")
    page.wait_for_url(re.compile(r"objects/\w+\.html"))
    assert page.evaluate("document.title").startswith("<script>")
