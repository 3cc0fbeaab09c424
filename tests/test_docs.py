"""The site of the documents: built strictly, without a broken link and without a request to elsewhere."""

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urldefrag, urlsplit

import axe_playwright_python
import html5lib
import markdown
import numpy as np
import pytest
from cyclopts import CycloptsError

import objectfolder
from pipeline.cli import application
from tests.browser import Watched
from tests.cache_key import checkout_key

pytest_plugins = ["tests.browser"]
REPOSITORY = Path(__file__).parents[1]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
AXE = Path(axe_playwright_python.__file__).parent / "axe.min.js"
LOADED = {("script", "src"), ("img", "src"), ("link", "href"), ("iframe", "src")}


@pytest.fixture(scope="module")
def pages(make_once: Callable[..., Path]) -> dict[Path, ElementTree.Element]:
    """The pages of the site by their paths. It is built anew where a file of the checkout changed."""

    def build(folder: Path) -> None:
        command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
        # Nothing outside this machine answers: a build that asks for something fails.
        offline = {**os.environ, "http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
        done = subprocess.run(
            command, cwd=REPOSITORY, env=offline, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, done.stdout + done.stderr

    folder = make_once("site", build, checkout_key())
    paths = sorted(folder.rglob("*.html"))
    return {path: html5lib.parse(path.read_bytes(), namespaceHTMLElements=False) for path in paths}


def parts(page: ElementTree.Element) -> list[tuple[str, dict[str, str]]]:
    return [(str(element.tag), element.attrib) for element in page.iter()]


def test_readme_is_short_and_begins_with_how_to_start():
    readme = (REPOSITORY / "README.md").read_bytes()
    assert len(readme) <= 6000
    for piece in (b".png)", b"make dataset", b"make test", b"import objectfolder"):
        assert piece in readme[:1000]
    prose = re.sub(r"```.*?```", "", readme.decode(), flags=re.DOTALL)
    assert len(re.findall(r"(?<![\w.])\.?\d[\d.,]*", prose)) <= 25


@pytest.mark.parametrize("page", ["README.md", "docs/guide.md", "docs/notebooks.md"])
def test_sentences_of_readme_and_tutorials_have_thirty_words_at_most(page):
    source = (REPOSITORY / page).read_text(encoding="utf-8")
    html = markdown.markdown(source, extensions=["fenced_code", "sane_lists", "tables"])
    tree = html5lib.parse(html, namespaceHTMLElements=False)
    texts = [
        " ".join("".join(part.itertext()).split()) for tag in ("p", "li", "td") for part in tree.iter(tag)
    ]
    # A sentence ends before a capital, a figure or a name in code.
    sentences = [sentence for text in texts for sentence in re.split(r"(?<=[.!?])\s+(?=\W*[A-Z\d])", text)]
    assert len(sentences) > 10
    assert [sentence for sentence in sentences if len(sentence.split()) > 30] == []


def blocks(language: str) -> list[tuple[str, str]]:
    """Blocks of code in the pages, with the page of each."""
    pattern = re.compile(rf"^```(?:{language})\b[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)
    return [
        (page.name, block) for page in PAGES for block in pattern.findall(page.read_text(encoding="utf-8"))
    ]


def test_commands_of_pages_exist_with_their_options():
    command, tried = application(), 0
    for page, block in blocks("console|bash"):
        for line in block.replace("\\\n", " ").splitlines():
            before_pipe = re.sub(r"\s[|>&].*", "", line.removeprefix("$ "))
            words = re.sub(r"^(?:[A-Z_]+=\S+ )+", "", before_pipe)
            if words.startswith("objectfolder "):
                tried += 1
                try:
                    command.parse_args(
                        shlex.split(words, comments=True)[1:], exit_on_error=False, print_error=False
                    )
                except CycloptsError as error:
                    pytest.fail(f"{page}: {line}: {error}")
    assert tried > 90


@pytest.mark.slow
def test_names_that_pages_import_exist():
    imported = 0
    for page, block in blocks("python"):
        for node in ast.walk(ast.parse(block, page)):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("objectfolder", "pipeline")):
                module = importlib.import_module(str(node.module))
                for alias in node.names:
                    imported += 1
                    assert alias.name in dir(module), f"{page}: {node.module}.{alias.name}"
    assert imported > 20


@pytest.mark.slow
@pytest.mark.parametrize("name", ["README.md", "guide.md", "ask.md"])
def test_python_of_a_page_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for path in ("mug.safetensors", "data/object_files/mug.safetensors"):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        objectfolder.example("mug").save(path)
    for page, block in blocks("python"):
        if page == name:
            exec(compile(block.replace("resolution=256", "resolution=32"), page, "exec"), names)
    answers = {name: answer for name, answer in names.items() if isinstance(answer, np.ndarray)}
    assert answers["images"].shape == (4, 32, 32, 3)
    assert np.ptp(answers["images"]) > 100
    assert np.shape(names["sounds"]) == (4, 88200)
    assert np.abs(names["sounds"]).max() > 0
    assert names.get("touches", names.get("touch")).depth_m.max() > 0


@pytest.mark.slow
def test_every_link_and_every_picture_leads_to_something(pages):
    all_parts = {path: parts(page) for path, page in pages.items() if path.name != "404.html"}
    anchors = {page: {has["id"] for _, has in parts if "id" in has} for page, parts in all_parts.items()}
    broken, followed = [], 0
    for page, elements in all_parts.items():
        for link in [has[key] for _, has in elements for key in ("href", "src") if key in has]:
            if urlsplit(link).scheme:
                continue
            address, anchor = urldefrag(link)
            target = (page.parent / unquote(address)).resolve() if address else page
            followed += 1
            if not target.exists() or (anchor and target in anchors and anchor not in anchors[target]):
                broken.append((page.name, link))
    assert broken == []
    assert followed > 1000


@pytest.mark.slow
def test_lists_and_tables_are_drawn_as_such(pages):
    for path, page in pages.items():
        texts = ["".join(paragraph.itertext()) for paragraph in page.iter("p")]
        assert [text for text in texts if re.search(r"^(- |\|)", text, re.MULTILINE)] == [], path


@pytest.mark.slow
def test_pages_load_nothing_from_elsewhere(pages):
    for path, page in pages.items():
        loads = [has[key] for tag, has in parts(page) for of, key in LOADED if tag == of and key in has]
        assert loads
        assert [address for address in loads if urlsplit(address).scheme in ("http", "https")] == [], path


@pytest.mark.slow
def test_page_of_measurements_has_each_recorded_result(pages):
    (page,) = (page for path, page in pages.items() if path.name == "measurements.html")
    cells = {"".join(cell.itertext()) for cell in page.iter("td")}
    recorded = {path.stem for path in (REPOSITORY / "bench" / "results").glob("*.json")}
    assert len(recorded) > 40
    assert recorded <= cells


@pytest.mark.slow
def test_reference_has_the_queries_of_an_object_file(pages):
    reference = [page for path, page in pages.items() if path.parent.name == "api"]
    names = {has.get("id") for page in reference for _, has in parts(page)}
    for name in (
        "vision.SightQueries.render", "vision.SightQueries.sample_views", "audio.SoundQueries.strike",
        "touch.TouchQueries.press", "touch.TouchQueries.sample_contacts", "object_file.ObjectFile.save",
        "load",
    ):  # fmt: skip
        assert f"objectfolder.{name}" in names


@pytest.mark.release("objectfolder", "docs")
def test_pages_of_the_reference_are_short(
    pages: dict[Path, ElementTree.Element], open_page: Callable[..., Watched]
):
    page = open_page("about:blank", viewport={"width": 1280, "height": 800}).page
    for path in (path for path in pages if path.parent.name == "api"):
        page.goto(path.as_uri())
        assert page.evaluate("document.documentElement.scrollHeight") <= 15000, path.name


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.release("docs"))])
def test_pages_are_accessible(
    scheme: str, pages: dict[Path, ElementTree.Element], open_page: Callable[..., Watched]
):
    page = open_page("about:blank", color_scheme=scheme, bypass_csp=True).page
    tried = ("index.html", "ask.html", "api/audio.html")  # a picture and tables, code, a reference
    for path in (path for path in pages if path.as_posix().endswith(tried)):
        page.goto(path.as_uri())
        page.add_script_tag(path=AXE)
        violations = page.evaluate("axe.run().then(result => result.violations)")
        assert [(rule["id"], rule["nodes"][0]["html"]) for rule in violations] == [], path.name
