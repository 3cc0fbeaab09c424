"""All parameters as a page: ``python -m docs.parameter_table > docs/parameters.md``."""

import dataclasses
import typing
from collections.abc import Iterator
from typing import Any, Literal

from pipeline.dataset.bounds import Bounds
from pipeline.dataset.parameters import CommonParameters, SizeParameters

HEAD = """# Parameters

`params.yaml` has everything that gives the data of a data set its meaning. It is read strictly: an unknown
key, a value of another type and a number out of its range are refused with key, value and range, also in a
size that is not selected. Sections below `sizes.NAME` stand once for each size.

This page is written from the code: `python -m docs.parameter_table > docs/parameters.md`.

| parameter | type | range | what it is |
|---|---|---|---|
"""
FOOT = """
`touch.depth_m` must be in order, and within what gel and camera of the sensor allow.
`touch.renderer: pyrender` draws rigid contact only.
"""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A parameter: dotted name without ``sizes.NAME``, type, range (None: no number), and meaning."""

    name: str
    type: str
    bounds: Bounds | None
    meaning: str


def parameters(section: Any, prefix: str = "") -> Iterator[Parameter]:
    """Yield the parameters of a section and of those in it."""
    for name, field in section.__pydantic_fields__.items():
        kind = field.annotation
        if dataclasses.is_dataclass(kind):
            yield from parameters(kind, f"{prefix}{name}.")
            continue
        bounds = next((note for note in (*field.metadata, *_inner(kind)) if isinstance(note, Bounds)), None)
        yield Parameter(
            prefix + name, _words(kind), bounds, field.description or (bounds and bounds.meaning) or ""
        )


def page() -> str:
    """Return the page, in Markdown."""
    rows = []
    for parameter in (*parameters(CommonParameters), *parameters(SizeParameters)):
        rows.append(
            f"| `{parameter.name}` | {parameter.type} | {parameter.bounds or ''} | {parameter.meaning} |\n"
        )
    return f"{HEAD}{''.join(rows)}{FOOT}"


def _inner(kind: Any) -> Iterator[Any]:
    """Yield the metadata of the parts of a type."""
    for part in typing.get_args(kind):
        yield from getattr(part, "__metadata__", ())


def _words(kind: Any) -> str:
    parts = typing.get_args(kind)
    if typing.get_origin(kind) is Literal:
        return " or ".join(f"`{part}`" for part in parts)
    if typing.get_origin(kind) is tuple:
        return "list of text" if Ellipsis in parts else f"list of {len(parts)} numbers"
    if type(None) in parts:
        return "number or null"
    words = {int: "whole number", float: "number", bool: "true or false", str: "text"}
    return words.get(kind, "text")


if __name__ == "__main__":
    print(page(), end="")
