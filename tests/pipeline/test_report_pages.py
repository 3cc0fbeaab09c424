"""Pages of a report as text: valid, self-contained, safe whatever the data say, made only when needed."""

import json
import re
import shutil
from contextlib import AbstractContextManager
from html.parser import HTMLParser
from pathlib import Path

import html5lib
import numpy as np
import pytest
from fidelity_products import FAILURE, fidelity, write_costs
from report_data_sets import HOSTILE, cube, write_object

from objectfolder.products.store import Array, Product, read_product, write_product
from objectfolder.simulators.parts_product import absent_parts, parts_product
from objectfolder.surface.convex_parts import ConvexParts
from objectfolder.surface.surface import Surface
from pipeline.cluster.cluster import runner
from pipeline.cluster.places import Place
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.job import Runner
from pipeline.publish.report import page_files
from pipeline.publish.report.object_page import STRIKES, page_name, shown_fingerprint
from pipeline.publish.report.page_files import RunnerFor
from pipeline.publish.report.report import write_report

HOSTILE_FAILURE = FailedObject("broken", HOSTILE, HOSTILE, HOSTILE)
UNICODE = "Krug «Größe» 茶碗 🏺 ‮right to left"


class Page(HTMLParser):
    """Tags, references and text of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.references: list[tuple[str, str]] = []
        self.text = ""
        self.tags: list[str] = []
        self.handlers: list[str] = []
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        names = {
            "src",
            "href",
            "srcset",
            "xlink:href",
            "data",
            "poster",
            "action",
            "background",
            "data-script",
            "data-sheet",
            "data-strikes",
        }
        self.references += [(tag, value or "") for name, value in attributes if name in names]
        self.handlers += [name for name, _ in attributes if name.startswith("on")]

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set: one of people's worst, one silent, one with a sense missing, one that failed before."""
    root = tmp_path_factory.mktemp("report")
    write_object(root / "data", "hostile", text=HOSTILE, shift=4.0)
    write_object(root / "data", "die", text=UNICODE, audible=False)
    write_object(root / "data", "deaf", senses="vt")
    write_object(root / "data", "mug")
    report(root)
    return root


def report(root: Path, runner_for: RunnerFor | None = None) -> None:
    costs = write_costs(root / "costs.csv", ["mug"])
    own = FailedObject("mug", "views", HOSTILE, "Again.")
    failures = [FAILURE, HOSTILE_FAILURE, own]
    write_report(root / "data" / "fidelity", costs, root / "reports", failures, runner_for=runner_for)


def pages_of(root: Path) -> list[Path]:
    return [root / "reports" / "index.html", *sorted((root / "reports" / "objects").glob("*.html"))]


def test_pages_are_valid_html(root: Path) -> None:
    for path in pages_of(root):
        html5lib.HTMLParser(strict=True).parse(path.read_text(encoding="utf-8"))


def test_ids_of_a_page_are_unique_and_labels_name_them(root: Path) -> None:
    for path in pages_of(root):
        source = path.read_text(encoding="utf-8")
        ids = re.findall(r'\sid="([^"]+)"', source)
        assert len(ids) == len(set(ids))
        for names in re.findall(r'\s(?:for|aria-labelledby)="([^"]+)"', source):
            assert set(names.split()) <= set(ids)


def test_pages_refer_to_nothing_beyond_their_folder(root: Path) -> None:
    beside = {path.name for path in (root / "reports" / "objects").iterdir()}
    for path in pages_of(root):
        page = Page(path)
        assert page.references
        for tag, reference in page.references:
            if tag == "a" and reference.startswith("https://"):
                continue
            local = reference.startswith(("data:", "#")) or reference.removeprefix("objects/") in beside
            assert local or reference == "../index.html", (tag, reference[:60])
        assert not {"iframe", "object", "embed", "base"} & set(page.tags)
        assert "@import" not in page.source
        assert not re.search(r"url\((?!#)", page.source)
        # Addresses stand in links and in their text, nowhere else.
        assert not re.search(r"https?://", re.sub(r'<a href="[^"]*"[^>]*>[^<]*</a>', "", page.source))


def test_hostile_text_is_text(root: Path) -> None:
    for path in pages_of(root):
        page = Page(path)
        assert page.handlers == []
        assert "x" not in [reference for _, reference in page.references]
        assert "<script>document" not in page.source
        assert page.tags.count("script") == (2 if path.name == "index.html" else 3), path.name
        assert page.tags.count("table") == page.source.count("</table>")
    text = Page(root / "reports" / "objects" / "hostile.html").text
    assert text.count(HOSTILE) >= 8, "name, material, licence, attribution, source, definitions, citation ..."
    assert Page(root / "reports" / "index.html").text.count(HOSTILE) >= 6


def test_only_named_scripts_may_run(root: Path) -> None:
    for path in pages_of(root):
        policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', path.read_text())
        assert policy
        directives = dict(
            part.strip().partition(" ")[::2] for part in policy[1].replace("&#39;", "'").split(";")
        )
        assert directives["default-src"] == "'none'"
        assert "unsafe" not in directives["script-src"]
        assert "connect-src" not in directives
        assert not any("http" in value or "*" in value for value in directives.values())


def test_the_index_says_what_is_known(root: Path) -> None:
    index = Page(root / "reports" / "index.html")
    assert "4 objects measured" in index.text
    assert "2 failed" in index.text
    assert index.source.index('class="figures"') < index.source.index('id="table"')
    rows = re.findall(r'<th scope="row"><a href="objects/(.*?)\.html"><img', index.source)
    assert rows[0] == "hostile", "the worst is first"
    assert set(rows) == {"hostile", "die", "deaf", "mug"}
    assert "broken" in index.text
    assert "1 silent object" in index.text
    assert "Own words of the product." in index.text
    assert "Distributions over objects" in index.text
    (values,) = re.findall(r'id="values">(.*?)</script>', index.source)
    numbers = json.loads(values)
    assert len(numbers) == 5
    assert numbers[0][1] == 31.0
    assert numbers[-1] == [None] * len(numbers[0])
    assert index.source.count('loading="lazy"') == 4


def test_a_page_shows_every_sense(root: Path) -> None:
    page = Page(root / "reports" / "objects" / "mug.html")
    assert page.tags.count("audio") == 2
    assert page.tags.count("canvas") == 2 * (4 + 3), "of stored pairs, and of what comes from the sheets"
    assert page.source.count('class="spot') == 4 + 1
    assert "views failed." in page.text
    assert "A. Maker" in page.text
    assert "density_kg_m3" in page.text.replace(" ", "_")
    assert "999" not in page.text, "the seconds of the product in use, not of an older one"
    assert "Silent: the solver finds no mode" in Page(root / "reports" / "objects" / "die.html").text
    deaf = Page(root / "reports" / "objects" / "deaf.html")
    assert "No held-out strike is stored." in deaf.text
    assert deaf.tags.count("audio") == 0


def test_neighbours_are_linked_in_the_order_of_ids(root: Path) -> None:
    for name, before, after in (("deaf", None, "die"), ("die", "deaf", "hostile"), ("mug", "hostile", None)):
        source = (root / "reports" / "objects" / f"{name}.html").read_text(encoding="utf-8")
        for relation, neighbour in (("prev", before), ("next", after)):
            link = re.search(rf'<a href="(\w+)\.html" rel="{relation}"', source)
            assert (link[1] if link else None) == neighbour


def test_a_broken_object_file_costs_the_player_alone(root: Path) -> None:
    text = Page(root / "reports" / "objects" / "mug.html").text
    assert "Left out: player:" in text
    assert not list((root / "reports" / "objects").glob("*.player.js"))


def stamps(root: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (root / "reports" / "objects").glob("*.html")}


def test_only_pages_that_show_something_else_are_made_again(tmp_path: Path) -> None:
    for object_id in "abcde":
        write_object(tmp_path / "data", object_id)
    report(tmp_path)
    first = stamps(tmp_path)
    index = tmp_path / "reports" / "index.html"
    inode, text = index.stat().st_ino, index.read_bytes()
    report(tmp_path)
    assert stamps(tmp_path) == first
    assert (index.stat().st_ino, index.read_bytes()) == (inode, text), "the first page is kept"

    path = tmp_path / "data" / "fidelity" / "b.zarr.zip"
    product = read_product(path)
    answer = product["vision_answer"].copy()
    answer[0, 0, 0] ^= 1
    arrays = {**product.arrays, "vision_answer": Array(answer, ("q", "y", "x", "c"), "1", "answer")}
    write_product(path, Product(arrays, product.attributes))
    report(tmp_path)
    changed = {name for name, stamp in stamps(tmp_path).items() if stamp != first[name]}
    assert changed == {"b.html"}, "a single bit of a picture"

    second = stamps(tmp_path)
    write_object(tmp_path / "data", "d", audible=False)
    report(tmp_path)
    assert {name for name, stamp in stamps(tmp_path).items() if stamp != second[name]} == {"d.html"}

    for folder in (tmp_path / "data").iterdir():
        for file in folder.glob("c.*"):
            file.unlink()
    third = stamps(tmp_path)
    report(tmp_path)
    fourth = stamps(tmp_path)
    assert third.keys() - fourth.keys() == {"c.html"}
    assert {name for name in fourth if fourth[name] != third[name]} == {"b.html", "d.html"}, "its neighbours"
    assert not list((tmp_path / "reports" / "objects").glob("c.*"))


def test_a_page_cut_short_is_made_again(tmp_path: Path) -> None:
    write_object(tmp_path / "data", "a")
    report(tmp_path)
    page = tmp_path / "reports" / "objects" / "a.html"
    whole = page.read_bytes()
    page.write_bytes(whole[:40])
    assert shown_fingerprint(page) == (None, False)
    report(tmp_path)
    assert page.read_bytes() == whole


@pytest.mark.slow
def test_workers_draw_pages_as_the_driver_does_and_only_those_that_changed(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_files, "FEW_PAGES", 0)
    counts: list[int] = []

    def runner_for(count: int) -> AbstractContextManager[Runner]:
        counts.append(count)
        return runner(Place(kwargs={"n_workers": 1, "threads_per_worker": 1}), tmp_path, 1)

    def files(folder: Path) -> dict[Path, bytes]:
        paths = {path.relative_to(folder): path for path in (folder / "reports").rglob("*.*")}
        # What is computed for sounds takes the instructions of its process.
        return {
            name: b"" if name.name.endswith(STRIKES) else path.read_bytes() for name, path in paths.items()
        }

    shutil.copytree(root / "data", tmp_path / "data")
    report(tmp_path, runner_for)
    assert files(tmp_path) == files(root)
    assert not any((tmp_path / page_files.FOLDER).iterdir())
    (tmp_path / "reports" / "objects" / "die.html").unlink()
    report(tmp_path, runner_for)
    assert counts == [4, 1]
    assert files(tmp_path) == files(root)


def test_an_id_that_is_no_file_name_gets_one(tmp_path: Path) -> None:
    names = ["../../escape", "a/b", "", ".", "x" * 300, "<b>", "mug"]
    pages = [page_name(name) for name in names]
    assert len(set(pages)) == len(pages)
    assert all(re.fullmatch(r"[\w.-]{1,110}\.html", page) for page in pages)
    assert pages[-1] == "mug.html"
    product = fidelity("mug")
    product = Product(product.arrays, {**product.attributes, "object": {"id": "../../escape", "name": "e"}})
    write_product(tmp_path / "data" / "fidelity" / "mug.zarr.zip", product)
    report(tmp_path)
    files = {path.relative_to(tmp_path) for path in tmp_path.rglob("*.html")}
    assert files == {Path("reports/index.html"), Path("reports/objects") / page_name("../../escape")}


def test_fewer_queries_are_the_worst_and_the_best(tmp_path: Path) -> None:
    write_object(tmp_path / "data", "mug")
    write_report(tmp_path / "data" / "fidelity", tmp_path / "costs.csv", tmp_path / "reports", pairs=2)
    source = (tmp_path / "reports" / "objects" / "mug.html").read_text(encoding="utf-8")
    assert re.findall(r'class="query" data-rank="\d+" data-place="([^"]*)"', source)[:2] == ["worst", "best"]
    assert source.count("<canvas") == 2 * (2 + 3)


def test_damaged_truth_leaves_the_page_with_what_there_is(tmp_path: Path) -> None:
    write_object(tmp_path / "data", "mug")
    for stage in ("touches", "modes"):
        path = tmp_path / "data" / stage / "mug.zarr.zip"
        path.write_bytes(path.read_bytes()[:100])
    report(tmp_path)
    page = Page(tmp_path / "reports" / "objects" / "mug.html")
    assert page.text.count("Left out:") == 3
    assert page.tags.count("canvas") == 14
    assert page.source.count('class="spot') == 0
    table = re.search(r'aria-label="Modal table".*?<tbody>(.*?)</tbody>', page.source, re.DOTALL)
    assert table
    rows = [re.findall("<td>(.*?)</td>", row) for row in re.findall("<tr>(.*?)</tr>", table[1])]
    assert len(rows) == 28
    assert {row[5] for row in rows} == {"3.000"}, "errors of modes need the Object File alone"
    assert {row[7] for row in rows} == {"\N{EN DASH}"}, "the solver's own error is the modes' product's"
    assert "Damped by the loss factor of the material." in page.text


def whole(path: Path, **arrays: np.ndarray) -> None:
    """Write a product again with other arrays, so that nothing of it is damaged."""
    product = read_product(path)
    more = {
        name: Array(value, tuple(f"axis_{axis}" for axis in range(value.ndim)), "1", name)
        for name, value in arrays.items()
    }
    write_product(path, Product({**product.arrays, **more}, product.attributes))


def test_warnings_of_an_object_stand_on_its_page(tmp_path: Path) -> None:
    for name, said in {"list": ["walls of <b>one</b> layer", 7], "text": "no list", "none": None}.items():
        write_object(tmp_path / "data", name)
        path = tmp_path / "data" / "fidelity" / f"{name}.zarr.zip"
        write_product(path, read_product(path).with_attributes(body={"warnings": said}))
    report(tmp_path)
    texts = {
        name: Page(tmp_path / "reports/objects" / f"{name}.html").text for name in ("list", "text", "none")
    }
    assert "Warning: walls of <b>one</b> layer" in texts["list"]
    assert {name: text.count("Warning:") for name, text in texts.items()} == {"list": 1, "text": 0, "none": 0}


def test_a_page_says_how_collision_parts_fit_or_why_there_are_none(tmp_path: Path) -> None:
    hull = Surface(*cube())
    products = {
        "mug": parts_product(ConvexParts((hull, hull), 0.834, 0.0021, 0.0)),
        "bell": absent_parts("parting takes <b>long</b>"),
        "die": Product({}, {"absent": None}),
        "fork": None,
    }
    (tmp_path / "data" / "collision").mkdir(parents=True)
    for name, product in products.items():
        write_object(tmp_path / "data", name)
        if product is not None:
            write_product(tmp_path / "data" / "collision" / f"{name}.zarr.zip", product)
    report(tmp_path)
    said = {name: Page(tmp_path / "reports/objects" / f"{name}.html").text for name in products}
    assert "simulators: 2 convex, 83 % of the volume" in said["mug"]
    assert "none sticks out by more than 2.1 mm" in said["mug"]
    assert "simulators: none, for parting takes <b>long</b>" in said["bell"]
    assert "collision: not what a report can show" in said["die"]
    assert all("Collision parts" not in said[name] for name in ("die", "fork"))


def test_an_open_surface_says_how_it_was_filled(tmp_path: Path) -> None:
    sentence = "has 13\u202f568 cm³, 5.1 % more than the open surface encloses (itself known to ± 1.4 %)"
    cases = {
        "more": (False, 0.0512, sentence),
        "less": (False, -0.001, "0.1 % less than"),
        "watertight": (True, 0.0512, None),
        "text": (False, "much", None),
    }
    for name, (watertight, change, _) in cases.items():
        write_object(tmp_path / "data", name)
        path = tmp_path / "data" / "fidelity" / f"{name}.zarr.zip"
        body = {"watertight": watertight, "filled_volume_m3": 0.013568}
        write_product(path, read_product(path).with_attributes(body=body))
        filled = {"discretisation": {"volume_error": change, "volume_uncertainty": 0.0137}}
        write_product(tmp_path / "data" / "modes" / f"{name}.zarr.zip", Product({}, filled))
    report(tmp_path)
    for name, (*_, said) in cases.items():
        text = Page(tmp_path / "reports" / "objects" / f"{name}.html").text
        assert ("Filled for sound" in text) == (said is not None), name
        assert said is None or said in text, name


def test_a_whole_product_of_another_kind_costs_its_part_of_the_page_alone(tmp_path: Path) -> None:
    flat = {"vision_truth": np.zeros((4, 9)), "vision_answer": np.zeros((4, 9))}
    mute = {"strike_truth": np.zeros(3)}
    cases: dict[str, tuple[str, dict[str, np.ndarray], str]] = {
        "flat": ("fidelity", flat, "views: not what"),
        "mute": ("fidelity", mute, "strikes: not what"),
        "split": ("modes", {"held_out": np.arange(50) < 40}, "modes: not what"),
        "places": ("fidelity", {"touch_pixels": np.zeros((6, 2))}, "contacts: not what"),
        "points": ("touches", {"points": np.zeros(7)}, "contacts: not what"),
    }
    for name, (stage, arrays, _) in cases.items():
        write_object(tmp_path / "data", name)
        whole(tmp_path / "data" / stage / f"{name}.zarr.zip", **arrays)
    report(tmp_path)
    for name, (*_, finding) in cases.items():
        page = Page(tmp_path / "reports" / "objects" / f"{name}.html")
        assert f"Left out: {finding}" in page.text, name
        assert page.tags.count("canvas") >= 4, name


ODD = {"number": 5, "text": "text", "list": [1], "names": {"a": 1}, "huge": 10**400}


def test_attributes_of_another_kind_stop_no_report(tmp_path: Path) -> None:
    """Every attribute in turn, each of an object of its own; all keep their rows, and the sound one all."""
    write_object(tmp_path / "data", "sound")
    folder = tmp_path / "data" / "fidelity"
    own = fidelity("odd").attributes
    variants = [{**own, part: odd} for part in own for odd in ODD.values()]
    for part, name in (("vision", "psnr_db"), ("vision", "per_view"), ("audio", "modes_table")):
        variants += [{**own, part: {**own[part], name: odd}} for odd in ODD.values()]
    for index, attributes in enumerate(variants):
        described = attributes["object"]
        if isinstance(described, dict) and "id" in described:
            attributes = {**attributes, "object": {**described, "id": f"odd_{index}"}}
        write_product(folder / f"odd_{index}.zarr.zip", Product({}, attributes))
    report(tmp_path)
    assert f"{len(variants) + 1} objects measured" in Page(tmp_path / "reports" / "index.html").text
    page = Page(tmp_path / "reports" / "objects" / "sound.html")
    assert "Left out:" in page.text, "its Object File makes no player"
    assert page.tags.count("canvas") == 14


def test_damage_that_leaves_the_stated_digest_is_seen(tmp_path: Path) -> None:
    write_object(tmp_path / "data", "mug")
    report(tmp_path)
    path = tmp_path / "data" / "object_files" / "mug.safetensors"
    content = bytearray(path.read_bytes())
    content[-3] ^= 1
    path.write_bytes(content)
    report(tmp_path)
    page = Page(tmp_path / "reports" / "objects" / "mug.html")
    assert "Left out: object_files/mug.safetensors: its content does not match its digest" in page.text
