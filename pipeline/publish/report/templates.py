"""The look shared by all pages: one base template, its style, and filters that print numbers for people.

A page's template extends ``base.html.j2`` and fills its blocks: title, nav, content; where wanted head,
styles, footer and scripts. Everything from outside is escaped.
"""

import base64
import hashlib
from collections.abc import Sequence
from pathlib import Path

import jinja2
from markupsafe import Markup

from pipeline.publish.report import formats

TEMPLATES = Path(__file__).parent / "template"


def template_environment(*folders: Path) -> jinja2.Environment:
    """Return an environment that finds templates in `folders`, then those of the report.

    It escapes, is strict about names that are not given, and has the functions of `formats` as filters and
    ``script(name)``, which puts a script of these folders into the page.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    printers = (formats.number, formats.digits, formats.megabytes, formats.percent, formats.seconds)
    links = (formats.licence_link, formats.web_link)
    environment.filters |= {function.__name__: function for function in (*printers, *links)}
    environment.globals["script"] = lambda name: Markup(f"<script>{_source(environment, name)}</script>")
    return environment


def security_policy(environment: jinja2.Environment, scripts: Sequence[str]) -> str:
    """Return a content security policy: these inlined scripts run, files beside the page load, no more.

    Text that slipped through as markup could then neither run nor send anything anywhere.

    Parameters
    ----------
    scripts
        Names of scripts of the environment that the page has by ``script(name)``.
    """
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(_source(environment, name).encode()).digest()).decode()}'"
        for name in scripts
    )
    return (
        f"default-src 'none'; script-src {hashes} blob: 'self' file:; "
        "style-src 'unsafe-inline' 'self' file:; img-src data: blob: 'self' file:; "
        "media-src data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'"
    )


def _source(environment: jinja2.Environment, name: str) -> str:
    assert environment.loader is not None
    return environment.loader.get_source(environment, name)[0]
