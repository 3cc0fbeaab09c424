"""The look shared by all pages: one base template, its style, and filters that print numbers for people.

A page's template extends ``base.html.j2`` and fills its blocks: title, nav, content; where wanted head,
styles, footer and scripts. Everything from outside is escaped.
"""

from pathlib import Path

import jinja2

from pipeline.report import formats

TEMPLATES = Path(__file__).parent / "template"


def template_environment(*folders: Path) -> jinja2.Environment:
    """Return an environment that finds templates in `folders`, then those of the report.

    Returns
    -------
    jinja2.Environment
        With autoescape, strict about names that are not given, and with the filters number, digits,
        megabytes, percent, licence_link and web_link of `formats`.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([*folders, TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": formats.number,
        "digits": formats.digits,
        "megabytes": formats.megabytes,
        "percent": formats.percent,
        "licence_link": formats.licence_link,
        "web_link": formats.web_link,
    }
    return environment
