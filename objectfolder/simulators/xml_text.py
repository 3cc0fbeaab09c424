"""XML of numbers: indented, every digit of a float kept."""

from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np


def number(value: float) -> str:
    """Return the shortest text that reads back as the same float."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Return numbers separated by spaces."""
    return " ".join(map(number, np.ravel(np.asarray(values, dtype=np.float64))))


def write_xml(path: Path, root: ElementTree.Element) -> None:
    """Write an indented document."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
    path.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")
