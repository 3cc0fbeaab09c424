"""Surfaces that are not closed."""

from collections.abc import Iterator

from pipeline.intake.check.entry import Entry
from pipeline.intake.check.finding import WARNING, Finding

RULE = "surface"


def check(entry: Entry) -> Iterator[Finding]:
    """Find surfaces that bound no solid: their volume and mass mean little."""
    if entry.shape is None or entry.shape.walls.closed:
        return
    topology = entry.shape.topology
    if topology.boundary_edges or topology.non_manifold_edges:
        found = (
            f"the surface is not closed: {topology.boundary_edges} boundary and "
            f"{topology.non_manifold_edges} non-manifold edges, {topology.components} pieces"
        )
    else:
        found = "the surface is closed but wound inconsistently, or bounds no positive volume"
    remedy = "Close it in an editor, or take its mass as that of the space that it mostly encloses"
    yield entry.found(RULE, WARNING, "mesh", found, remedy)
