"""Compares two products of an object: why they differ, and which of their arrays differ.

What products say is enough for most. Those that were made from the same and yet are of other bytes contradict
themselves, and are read whole.
"""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.audit.arrays import Arrays, by_checksums, by_reading, stored_tolerances
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.reasons import BYTES, CORRUPTED, UNREADABLE, Circumstances, Reason, why
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN
from pipeline.dataset import products
from pipeline.dataset.stage import Stage

# What is read without being asked to, in all.
MOST_PRODUCTS = 32
MOST_BYTES = 256 << 20
ASK = "made from the same, other bytes: --arrays reads them"


class ProductComparison:
    """Compares products, reading few of them whole unless it was asked to read all.

    Parameters
    ----------
    contents
        Where they are read from.
    read_arrays
        Whether all are to be read whole; then what is far is fetched, too.
    """

    def __init__(self, contents: Contents, read_arrays: bool) -> None:
        self.read_arrays = read_arrays
        self._contents = contents
        self._products, self._bytes = MOST_PRODUCTS, MOST_BYTES

    def compare(
        self,
        stage: Stage,
        contents: tuple[Content, Content],
        said: tuple[Description, Description],
        around: Circumstances,
    ) -> tuple[Arrays, list[Reason]]:
        """Return how the arrays of two products compare, and why they differ.

        Parameters
        ----------
        stage
            Which makes them.
        contents, said
            The products and what they say of themselves, the earlier one first.
        around
            What else explains a difference.
        """
        reasons = why(stage, *said, around)
        suspicious = all(one.kind == BYTES for one in reasons)
        arrays, defects = _by_checksums(*said)
        if self.read_arrays or (suspicious and self._affords(contents)):
            try:
                with self._file(contents[0], "earlier") as old, self._file(contents[1], "later") as new:
                    defects = [*_damage("earlier", old), *_damage("later", new)]
                    if not defects:
                        allowed, stored = stored_tolerances(stage, *reversed(said))
                        arrays = by_reading(old, new, allowed)
                        reasons = [Reason(BYTES, note=_sentence(arrays, stored))] if suspicious else reasons
            except ObjectFolderError as error:
                kind = CORRUPTED if isinstance(error, FormatError) else UNREADABLE
                defects = [Reason(kind, note=error.finding)]
        elif suspicious:
            reasons = [Reason(BYTES, note=ASK)]
        if defects:
            reasons = defects if suspicious else [*defects, *reasons]
        return arrays, reasons

    def _affords(self, contents: tuple[Content, Content]) -> bool:
        sizes = [self._contents.size(one) for one in contents]
        if None in sizes or self._products < 1 or self._bytes < sum(filter(None, sizes)):
            return False
        self._products -= 1
        self._bytes -= sum(filter(None, sizes))
        return True

    @contextmanager
    def _file(self, content: Content, name: str) -> Iterator[Path]:
        """Yield a file with the content, named as products are."""
        with tempfile.TemporaryDirectory(prefix="objectfolder-audit-") as folder:
            path = Path(folder) / f"{name}{content.suffix}"
            self._contents.place(content, path)
            yield path


def _by_checksums(before: Description, after: Description) -> tuple[Arrays, list[Reason]]:
    """Compare two products by the checksums in them, where they have any; a damaged list is a defect."""
    if not (before.listing and after.listing):
        return Arrays(unread=1), []
    try:
        return by_checksums(before, after), []
    except ValueError:
        damage = (("earlier", before.damage), ("later", after.damage))
    return Arrays(unread=1), [
        Reason(CORRUPTED, note=f"the {which} one: {text}") for which, text in damage if text
    ]


def _damage(which: str, path: Path) -> list[Reason]:
    """Return the fault of a whole product."""
    try:
        products.verify(path)
    except FormatError as error:
        return [Reason(CORRUPTED, note=f"the {which} one: {error.finding}")]
    except FileNotFoundError:
        return [Reason(CORRUPTED, note=f"the {which} one: it is gone")]
    return []


def _sentence(found: Arrays, stored: bool) -> str:
    counts = found.count()
    if counts.get(DIFFERENT):
        names = [name for name, verdict in found.verdicts.items() if verdict == DIFFERENT]
        text = f"made from the same, beyond tolerance: {', '.join(names[:3])}"
        text += f" and {len(names) - 3} more" if len(names) > 3 else ""
    elif counts.get(WITHIN):
        text = f"made from the same, {counts[WITHIN]} arrays within tolerance, {counts.get(EQUAL, 0)} equal"
    else:
        text = "made from the same, arrays equal, packed otherwise"
    return text if stored else f"{text}; tolerances as declared now, none are stored"
