"""An audit as one HTML page that needs no network."""

from pathlib import Path

from objectfolder.products.atomic import write_whole
from pipeline.audit.findings import Audit
from pipeline.publish.report.templates import template_environment


def write_page(path: Path, audit: Audit, text: str) -> None:
    """Write the words of an audit, atomically; what objects and commits say of themselves is escaped."""
    page = template_environment().get_template("audit.html.j2").render(audit=audit, text=text)
    write_whole(path, page)
