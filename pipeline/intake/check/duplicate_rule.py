"""Objects that are in a table twice."""

import math
from collections.abc import Callable, Iterator, Sequence

from pipeline.intake.check.entry import ERROR, NOTE, WARNING, Entry, Finding, Shape

RULE = "duplicate"

SAME = 1e-5
"""Relative difference of measures of one surface: coordinates of 6 decimals, or in single precision."""

Key = Callable[[Entry], str | None]
SHARED: tuple[tuple[str, str, Key], ...] = (
    ("the source", "source_id", lambda entry: entry.cell("source_id")),
    ("the mesh file", "mesh", lambda entry: entry.cell("mesh")),
    ("the bytes of the mesh", "mesh", lambda entry: entry.shape.mesh_sha256 if entry.shape else None),
)


def check(entries: Sequence[Entry]) -> Iterator[Finding]:
    """Find rows that share a source, a mesh, a surface or a texture; each once, at the later row."""
    id_pairs: set[tuple[str, str]] = set()
    pairs = [(noun, column, pair) for noun, column, key in SHARED for pair in _sharing(entries, key)] + [
        ("the cleaned surface", "mesh", pair) for pair in _alike(entries)
    ]
    for noun, column, (first, second) in pairs:
        if (first.object_id, second.object_id) in id_pairs:
            continue
        id_pairs.add((first.object_id, second.object_id))
        same = first.cell("material") == second.cell("material")
        finding = f"shares {noun} with {first.object_id}" + (
            ", and the material" if same else f", which is of {first.cell('material')}"
        )
        remedy = "Remove one of them" if same else "Keep both only if both materials are meant"
        yield second.finding(RULE, ERROR if same else WARNING, column, finding, remedy)
    for first, second in _sharing(entries, lambda entry: entry.shape.texture_sha256 if entry.shape else None):
        if (first.object_id, second.object_id) not in id_pairs:
            finding = f"shares the texture with {first.object_id}"
            yield second.finding(
                RULE, NOTE, "texture", finding, "Right for pieces of one set; else correct it"
            )


def _sharing(entries: Sequence[Entry], key: Key) -> Iterator[tuple[Entry, Entry]]:
    firsts: dict[str, Entry] = {}
    for entry in entries:
        value = key(entry)
        if value:
            first = firsts.setdefault(value, entry)
            if first is not entry:
                yield first, entry


def _alike(entries: Sequence[Entry]) -> Iterator[tuple[Entry, Entry]]:
    """Yield rows whose surfaces have as many faces and the same measures: copies, re-exported or moved."""
    of_faces: dict[int, list[tuple[Entry, Shape]]] = {}
    for entry in entries:
        if entry.shape is None:
            continue
        candidates = of_faces.setdefault(entry.shape.faces, [])
        for first, shape in candidates:
            pairs = zip(entry.shape.likeness, shape.likeness, strict=True)
            if all(math.isclose(*pair, rel_tol=SAME) for pair in pairs):
                yield first, entry
                break
        else:
            candidates.append((entry, entry.shape))
