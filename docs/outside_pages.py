"""Give the site what lies beside docs/: pages at the root, measured pictures, and a gallery if made."""

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
PAGES = (
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CITATION.cff",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "LICENSE",
    "SECURITY.md",
)


# As `make docs` writes it; without it the first page has its picture alone.
GALLERY = ROOT / ".objectfolder" / "gallery"
HERO = re.compile(r"^!\[.*hero\.png\)$", re.MULTILINE)
FRAME = """
<iframe src="gallery/index.html" title="Objects to turn, strike and press" loading="lazy"
 style="width: 100%; height: 36rem; border: 0"></iframe>

These are Object Files: turn, strike and press them [on pages of their own](gallery/index.html).
"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add them under the paths that they have in the repository."""
    for path in [*PAGES, *(str(path.relative_to(ROOT)) for path in ROOT.glob("bench/results/*.png"))]:
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    for source in (path for path in GALLERY.rglob("*") if path.is_file()):
        place = f"gallery/{source.relative_to(GALLERY).as_posix()}"
        files.append(File.generated(config, place, abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Bring links between docs/ and the root, which are one folder in the site, and the gallery's frame."""
    if page.file.src_uri == "README.md" and GALLERY.is_dir():
        markdown = HERO.sub(lambda hero: hero[0] + "\n" + FRAME, markdown)
    inside = "../" * page.file.src_uri.count("/")  # from the page to docs/
    return re.sub(rf"\]\((?:docs/|{re.escape(inside)}\.\./)", f"]({inside}", markdown)
