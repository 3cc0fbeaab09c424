"""Give the site what lies beside docs/: the pages at the root of the repository and measured pictures."""

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


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add them under the paths that they have in the repository."""
    for path in [*PAGES, *(str(path.relative_to(ROOT)) for path in ROOT.glob("bench/results/*.png"))]:
        files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Bring links between docs/ and the root of the repository, which are one folder in the site."""
    inside = "../" * page.file.src_uri.count("/")  # from the page to docs/
    return re.sub(rf"\]\((?:docs/|{re.escape(inside)}\.\./)", f"]({inside}", markdown)
