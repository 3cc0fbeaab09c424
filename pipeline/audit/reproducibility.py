"""Which values of a product are the same bytes on every machine, and how far the others may differ.

A fingerprint names everything that a product is made from, and no processor: a product made on another
machine counts as current. That is right within what is declared here, which is written into each product's
provenance and held against measurements by ``bench/factory/machines.py`` and the tests. Whatever is not
declared is the same bytes.
"""

import contextlib
import fnmatch
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from objectfolder.errors import FormatError
from objectfolder.products.store import read_product
from objectfolder.products.tensor_file import read_tensor_file
from pipeline.audit.descriptions import Description
from pipeline.dataset import products
from pipeline.dataset.tolerances import SAME_BYTES, Tolerance

EQUAL, WITHIN, DIFFERENT = "equal", "within tolerance", "different"
# What a product says of its making, not of the object.
MAKING = ("fingerprint", "provenance", "content_digest")
ATTRIBUTE = "attributes/"


@dataclass(frozen=True)
class Difference:
    """How one array or attribute of two products compares.

    Parameters
    ----------
    name
        The array, or the attribute behind `ATTRIBUTE` with slashes between its keys.
    verdict
        `EQUAL` (same bytes), `WITHIN` or `DIFFERENT`.
    largest
        Largest difference of two values, in the array's unit; infinite where they cannot be subtracted.
    relative
        The same as a share of the array's range (of its magnitude, where all its values are one).
    rms
        Root mean square of the differences as such a share.
    """

    name: str
    verdict: str
    largest: float = 0.0
    relative: float = 0.0
    rms: float = 0.0


@dataclass(frozen=True)
class Arrays:
    """Verdicts on the arrays of products.

    Parameters
    ----------
    verdicts
        Array name to `EQUAL`, `WITHIN` or `DIFFERENT`.
    unread
        Number of products whose arrays carry no checksums of their own and were not read.
    largest
        Array name to the largest difference, in the array's unit, where it was read and is not equal.
    """

    verdicts: Mapping[str, str] = field(default_factory=dict)
    unread: int = 0
    largest: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def read(cls, differences: Sequence[Difference]) -> "Arrays":
        """Return the verdicts of differences."""
        apart = {
            difference.name: difference.largest for difference in differences if difference.verdict != EQUAL
        }
        return cls({difference.name: difference.verdict for difference in differences}, largest=apart)

    def __add__(self, other: "Arrays") -> "Arrays":
        return Arrays(
            {**self.verdicts, **other.verdicts}, self.unread + other.unread, {**self.largest, **other.largest}
        )

    def count(self) -> Counter[str]:
        """Return how many there are of each verdict."""
        return Counter(self.verdicts.values())

    def different(self) -> str:
        """Name the first arrays that are different; empty where none is."""
        names = [name for name, verdict in self.verdicts.items() if verdict == DIFFERENT]
        return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def stored_tolerances(
    declared: Mapping[str, Tolerance], *descriptions: Description
) -> tuple[Mapping[str, Tolerance], bool]:
    """Return the tolerances that the first of the products stores, and whether any stores them.

    Products from before tolerances were stored are judged by what is declared now.
    """
    for description in descriptions:
        with contextlib.suppress(LookupError, ValueError):
            return TypeAdapter(dict[str, Tolerance]).validate_python(
                description.provenance["tolerances"]
            ), True
    return declared, False


def compare(first: Path, second: Path, tolerances: Mapping[str, Tolerance]) -> list[Difference]:
    """Compare two products of one object, made from the same inputs on two machines, array by array.

    Parameters
    ----------
    first
        The reference: shares are of its ranges.
    second
        The other.
    tolerances
        By pattern of names, the first that fits; what none fits has to be the same bytes.

    Returns
    -------
    list of Difference
        One for each array and each attribute of either, by name; those only one of them has are `DIFFERENT`.

    Raises
    ------
    FormatError
        A damaged product.
    """
    reference, candidate = _values(first), _values(second)
    differences = []
    for name in sorted(reference.keys() | candidate.keys()):
        if name in reference and name in candidate:
            differences.append(difference(name, reference[name], candidate[name], _for(name, tolerances)))
        else:
            differences.append(Difference(name, DIFFERENT, np.inf, np.inf, np.inf))
    return differences


def difference(name: str, first: np.ndarray, second: np.ndarray, allowed: Tolerance) -> Difference:
    """Compare two arrays under a tolerance."""
    unlike = Difference(name, DIFFERENT, np.inf, np.inf, np.inf)
    if first.shape != second.shape or first.dtype != second.dtype:
        return unlike
    if first.tobytes() == second.tobytes():
        return Difference(name, EQUAL)
    if first.dtype.kind not in "biuf":
        return unlike
    reference, candidate = first.astype(np.float64), second.astype(np.float64)
    finite = np.isfinite(reference)
    if not np.array_equal(
        np.where(finite, 0.0, reference), np.where(np.isfinite(candidate), 0.0, candidate), equal_nan=True
    ):
        return unlike
    apart = np.abs(np.subtract(reference, candidate, where=finite, out=np.zeros_like(reference)))
    scale = _scale(reference[finite])
    largest, rms = float(apart.max(initial=0.0)), float(np.sqrt(np.mean(apart**2)))
    within = allowed != SAME_BYTES and (
        largest <= allowed.absolute + allowed.relative * scale
        and rms <= allowed.absolute + allowed.rms * scale
    )
    share = 1 / scale if scale else np.inf
    verdict = WITHIN if within else DIFFERENT
    return Difference(name, verdict, largest, largest * share, rms * share)


def _scale(values: np.ndarray) -> float:
    """Range of the values, or their magnitude if all are equal."""
    if not values.size:
        return 0.0
    span = float(values.max() - values.min())
    return span or float(np.abs(values).max())


def _for(name: str, tolerances: Mapping[str, Tolerance]) -> Tolerance:
    """The tolerance of the first pattern that fits."""
    return next((value for key, value in tolerances.items() if fnmatch.fnmatchcase(name, key)), SAME_BYTES)


def _values(path: Path) -> dict[str, np.ndarray]:
    """Arrays and attributes of a product by name."""
    products.verify(path)
    if path.name.endswith(products.TENSORS):
        content = read_tensor_file(path)
        arrays = dict(content.tensors)
        attributes: dict[str, Any] = {key: _parsed(text) for key, text in content.metadata.items()}
    else:
        product = read_product(path)
        arrays = {name: array.data for name, array in product.arrays.items()}
        attributes = dict(product.attributes)
    for key in MAKING:
        attributes.pop(key, None)
    try:
        leaves = {ATTRIBUTE + name: np.asarray(value) for name, value in _leaves(attributes, "")}
    except RecursionError as error:
        finding = "its attributes are too deep"
        raise FormatError(str(path), finding, "Delete it; a run makes it again.") from error
    return {**arrays, **leaves}


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _leaves(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Values inside dictionaries and lists with their paths; a list of numbers is one value."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}/{key}" if name else str(key))
    elif isinstance(value, list) and not all(type(entry) in (int, float) for entry in value):
        for index, inner in enumerate(value):
            yield from _leaves(inner, f"{name}/{index}")
    else:
        yield name, "none" if value is None else value
