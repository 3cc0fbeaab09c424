"""An audit as one HTML page that needs no network."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from objectfolder.atomic import atomic_write
from pipeline.audit import table
from pipeline.audit.fidelity import MEASURES, FidelityChange
from pipeline.audit.findings import CHANGED, GONE, MADE, STATES, Audit
from pipeline.audit.groups import StageTotal, groups, names, totals
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN
from pipeline.publish.report.templates import template_environment

FIDELITY_ROWS = 1000


def write_page(
    audit: Audit,
    path: Path,
    exceeded: Sequence[FidelityChange] = (),
    allowed: Mapping[str, float] | None = None,
) -> None:
    """Write what an audit found, atomically.

    Parameters
    ----------
    audit
        What it found; ids, names and errors from outside are escaped.
    path
        The page.
    exceeded
        What lost more than was allowed.
    allowed
        The largest loss allowed by measure.
    """
    text = render_page(audit, exceeded, allowed or {})
    with atomic_write(path) as file:
        file.write(text.encode())


def render_page(audit: Audit, exceeded: Sequence[FidelityChange], allowed: Mapping[str, float]) -> str:
    """Return the page."""
    environment = template_environment()
    filters: dict[str, Callable[..., object]] = {
        "names": lambda found: names(found, most=len(found)),
        "change": table.change,
        "before": lambda one: table.value(one.measure, one.before),
        "after": lambda one: table.value(one.measure, one.after),
        "size": table.size,
        "numbers": _numbers,
    }
    environment.filters |= filters
    count = Counter(one.state for one in audit.objects)
    return environment.get_template("audit.html.j2").render(
        audit=audit,
        counts=", ".join(f"{count[state]} {state}" for state in STATES if count[state]) or "none",
        groups=groups(audit),
        stages=totals(audit),
        measures=MEASURES,
        most=FIDELITY_ROWS,
        cost=table.cost(audit),
        exceeded=exceeded,
        allowed=[(key, f"{loss:g} {MEASURES[key].unit}".strip()) for key, loss in allowed.items()],
    )


def _numbers(one: StageTotal) -> list[str]:
    """Return the cells of a row, empty where there is nothing."""
    numbers = [one.states.get(state, 0) for state in (CHANGED, MADE, GONE)]
    numbers += [one.arrays.get(verdict, 0) for verdict in (EQUAL, WITHIN, DIFFERENT)]
    return [*(str(number or "") for number in (*numbers, one.unread)), table.seconds(one)]
