"""Lengths: slips of unit, lengths of another side, and what differs from the paper's."""

from collections.abc import Iterator

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import ERROR, NOTE, WARNING, Finding
from pipeline.intake.check.provenance_rule import source_of
from pipeline.intake.check.shape import Shape

RULE = "length"

SAME = 0.03
"""Relative difference within which two lengths of a scan are the same."""


def check(entry: Entry) -> Iterator[Finding]:
    """Find lengths that the mesh or the published list contradicts."""
    if entry.record is None or entry.shape is None:
        return
    stated = entry.record.length_m
    if stated is not None:
        yield from _against_mesh(entry, entry.shape, stated)
    yield from _against_paper(entry, entry.shape.length_m)


def _against_mesh(entry: Entry, shape: Shape, stated: float) -> Iterator[Finding]:
    side = shape.file_length
    factor = stated / side
    if is_close(factor, 1):
        return
    what = f"the stated {stated:.4g} m is {factor:.3g} times the longest side of the mesh, {side:.4g}"
    for other, axis in sorted(zip(shape.file_extents, "xyz", strict=True), reverse=True)[1:]:
        if is_close(stated / other, 1) and not is_close(side / other, 1):
            found = f"{what}; it is the side along {axis} ({other:.4g})"
            remedy = f"Give the longest side ({side:.4g}), or 'as in file'"
            yield entry.found(RULE, WARNING, "length_m", found, remedy)
            return
    # A mesh of one's own may be in any unit; those of all public sources are in metres.
    if source_of(entry) is not None:
        severity = ERROR if not 1 / 3 <= factor <= 3 else WARNING
        remedy = f"Write {side:.4g}, or 'as in file'"
        yield entry.found(RULE, severity, "length_m", f"{what}, which is in metres", remedy)


def _against_paper(entry: Entry, length_m: float) -> Iterator[Finding]:
    papers = entry.number("paper_length_m")
    if papers is None or is_close(papers / length_m, 1):
        return
    found = f"{length_m:.4g} m, where the paper has {papers:.4g} m ({papers / length_m:.3g} times as long)"
    if entry.cell("notes"):
        yield entry.found(RULE, NOTE, "paper_length_m", found, "The notes should say why")
    else:
        yield entry.found(RULE, WARNING, "paper_length_m", found, "Say in the notes why")


def is_close(ratio: float, one: float) -> bool:
    """Whether a ratio is another one within what scans of one object differ by."""
    return abs(ratio / one - 1) <= SAME
