"""The page of an audit in a real browser: checked for accessibility and markup, and watched."""

from pathlib import Path

import axe_playwright_python
import html5lib
import pytest
from versions_of_workshop import made_versions

from pipeline import cli as command_line
from pipeline.dataset import stages

pytest_plugins = ["tests.browser"]
AXE = Path(axe_playwright_python.__file__).parent / "axe.min.js"
PHONE = {"width": 360, "height": 740}


@pytest.fixture(scope="module")
def page_of_audit(tmp_path_factory):
    """The page of two versions, of which one object changed by its material."""
    folder = tmp_path_factory.mktemp("audit_browser")
    with (
        made_versions(folder, "workshop_of_browser", cup="steel", dish="wood") as workshop,
        pytest.MonkeyPatch.context() as patch,
    ):
        workshop.row("cup")["material"] = "glass"
        workshop.save()
        workshop.version("third")
        patch.chdir(workshop.root)
        patch.setattr(stages, "STAGES", {stage.name: stage for stage in workshop.stages})
        path = folder / "page.html"
        assert command_line.main(["audit", "HEAD~1", "HEAD", "--html", str(path)]) == 0
        yield path


def test_markup_is_strict(page_of_audit):
    html5lib.HTMLParser(strict=True).parse(page_of_audit.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    "scheme", ["dark", pytest.param("light", marks=pytest.mark.release("pipeline.audit"))]
)
def test_axe_finds_nothing_in_an_audit(page_of_audit, open_page, scheme):
    watched = open_page(page_of_audit, color_scheme=scheme, bypass_csp=True)
    assert "cup" in watched.page.inner_text("body")
    watched.page.evaluate("for (const details of document.querySelectorAll('details')) details.open = true")
    watched.page.add_script_tag(path=str(AXE))
    violations = watched.page.evaluate("axe.run().then(result => result.violations)")
    assert [(rule["id"], rule["nodes"][0]["html"]) for rule in violations] == []


def test_an_audit_fits_a_phone_and_asks_for_nothing(page_of_audit, open_page):
    watched = open_page(page_of_audit, viewport=PHONE)
    assert watched.page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert watched.left_the_machine == []
    assert watched.errors == []
