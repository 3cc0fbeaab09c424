"""An audit as one HTML page that needs no network."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from objectfolder.atomic import atomic_write
from pipeline.audit import table
from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.findings import Audit
from pipeline.audit.groups import counts, groups, names, totals
from pipeline.publish.report.templates import template_environment

FIDELITY_ROWS = 1000


def write_page(
    audit: Audit, path: Path, exceeded: Sequence[FidelityChange], allowed: Mapping[str, float]
) -> None:
    """Write what an audit found, and what lost more than was allowed by measure, atomically.

    What objects and commits say of themselves is escaped.
    """
    environment = template_environment()
    environment.filters |= {
        "names": lambda found: names(found, most=len(found)),
        "change": table.change,
        "before": lambda one: table.value(one.measure, one.before),
        "after": lambda one: table.value(one.measure, one.after),
        "size": table.size,
    }
    page = environment.get_template("audit.html.j2").render(
        audit=audit,
        counts=counts(audit),
        groups=groups(audit),
        stages=totals(audit),
        measures=MEASURES,
        most=FIDELITY_ROWS,
        cost=table.cost(audit),
        exceeded=exceeded,
        allowed=[(key, f"{loss:g} {MEASURES[key].unit}".strip()) for key, loss in allowed.items()],
    )
    with atomic_write(path) as file:
        file.write(page.encode())
