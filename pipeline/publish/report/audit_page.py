"""An audit as one HTML page that needs no network."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.filesize import decimal

from objectfolder.products.atomic import atomic_write
from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.findings import Audit, change, cost, counts, groups, names, totals, value
from pipeline.publish.report.templates import template_environment

FIDELITY_ROWS = 1000


def write_page(
    audit: Audit, path: Path, exceeded: Sequence[FidelityChange], allowed: Mapping[str, float]
) -> None:
    """Write what an audit found, and what lost more than was allowed by measure, atomically.

    What objects and commits say of themselves is escaped.
    """
    environment = template_environment()
    stages = totals(audit)
    environment.filters |= {
        "names": lambda found: names(found, most=len(found)),
        "change": change,
        "before": lambda one: value(one.measure, one.before),
        "after": lambda one: value(one.measure, one.after),
        "size": decimal,
    }
    page = environment.get_template("audit.html.j2").render(
        audit=audit,
        counts=counts(audit),
        groups=groups(audit),
        stages=stages,
        measures=MEASURES,
        most=FIDELITY_ROWS,
        cost=cost(stages),
        exceeded=exceeded,
        allowed=[(key, f"{loss:g} {MEASURES[key].unit}".strip()) for key, loss in allowed.items()],
    )
    with atomic_write(path) as file:
        file.write(page.encode())
