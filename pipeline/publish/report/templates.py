"""The look shared by all pages: one base template, its style, and filters that print numbers for people.

A page's template extends ``base.html.j2`` and fills its blocks: title, nav, content; where wanted head,
styles, footer and scripts. Everything from outside is escaped.
"""

import base64
import hashlib
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from pipeline.dataset.measures import MINUS, NOTHING, megabytes, number
from pipeline.publish.cards.licences import Licence
from pipeline.publish.viewer.joined_scripts import joined_script

TEMPLATES = Path(__file__).parent / "template"
TIMES = "\N{MULTIPLICATION SIGN}"


def digits(value: Any, count: int = 3) -> str:
    """Return a number to a count of significant digits."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value and not 1e-4 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{count - 1}e}".split("e")
        superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
        return f"{mantissa} {TIMES} 10{str(int(exponent)).translate(superscripts)}".replace("-", MINUS)
    decimals = max(0, count - 1 - math.floor(math.log10(abs(value)))) if value else 0
    return number(value, decimals)


def seconds(value: float) -> str:
    """Return seconds with a unit that keeps the number short."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= size * 0.9999:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def percent(share: Any) -> str:
    """Return a share of one in percent."""
    return NOTHING if share is None else f"{number(100 * share, 1 if share < 0.1 else 0)} %"


def licence_link(licence: Any) -> str | None:
    """Return the address of a known licence's text, or the address that `licence` itself is."""
    return web_link(Licence.of(str(licence or "")).url)


def web_link(text: Any) -> str | None:
    """Return `text` where it is a web address and nothing else, else None."""
    address = str(text or "").strip()
    return address if re.fullmatch(r"https?://[^\s\"'<>]+", address) else None


def template_environment(*folders: Path) -> jinja2.Environment:
    """Return an environment that finds templates in `folders`, then those of the report.

    It escapes, is strict about names that are not given, and has the functions above as filters and
    ``script(name)``, which puts a script of these folders into the page, with those that it imports.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    printers = (number, digits, megabytes, percent, seconds)
    links = (licence_link, web_link)
    environment.filters |= {function.__name__: function for function in (*printers, *links)}
    environment.globals["script"] = lambda name: Markup(f"<script>{_script(environment, name)}</script>")
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
        f"'sha256-{base64.b64encode(hashlib.sha256(_script(environment, name).encode()).digest()).decode()}'"
        for name in scripts
    )
    return (
        f"default-src 'none'; script-src {hashes} blob: 'self' file:; "
        "style-src 'unsafe-inline' 'self' file:; img-src data: blob: 'self' file:; "
        "media-src data: blob: 'self' file:; worker-src blob:; base-uri 'none'; form-action 'none'"
    )


def _script(environment: jinja2.Environment, name: str) -> str:
    def source(name: str) -> str:
        assert environment.loader is not None
        return environment.loader.get_source(environment, name)[0]

    return joined_script(name, source)
