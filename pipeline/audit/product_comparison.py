"""Compares two products of an object: why they differ, and which of their arrays differ.

What products say is enough for most. Those that were made from the same and yet are of other bytes contradict
themselves, and are read whole.
"""

import tempfile
from pathlib import Path

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.reasons import BYTES, CORRUPTED, UNREADABLE, Circumstances, why
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN, Arrays, compare, stored_tolerances
from pipeline.dataset.archives import GROUP
from pipeline.dataset.differences import Reason
from pipeline.dataset.stage import Stage

MOST_PRODUCTS = 32  # pairs that are read without being asked to
EARLIER, LATER = "earlier", "later"
ASK = "made from the same, other bytes: --arrays reads them"


class ProductComparison:
    """Compares products; only a few are read whole, unless `read_arrays` is set."""

    def __init__(self, contents: Contents, read_arrays: bool) -> None:
        self.read_arrays = read_arrays
        self._contents = contents
        self._unasked = 0

    def compare(
        self,
        stage: Stage,
        contents: tuple[Content, Content],
        descriptions: tuple[Description, Description],
        around: Circumstances,
    ) -> tuple[Arrays, list[Reason]]:
        """Return how the arrays of two products, the earlier one first, compare, and why they differ."""
        reasons = why(stage, *descriptions, around)
        suspicious = all(reason.kind == BYTES for reason in reasons)
        arrays, defects = _by_checksums(*descriptions)
        if self.read_arrays or (suspicious and self._affords(contents)):
            try:
                arrays, sentence = self._read(stage, contents, descriptions)
                defects, reasons = [], [Reason(BYTES, note=sentence)] if suspicious else reasons
            except FormatError as error:
                defects = [_corrupted(Path(error.where).name.partition(".")[0], error.finding)]
            except ObjectFolderError as error:
                defects = [Reason(UNREADABLE, note=error.finding)]
        elif suspicious:
            reasons = [Reason(BYTES, note=ASK)]
        if defects:
            reasons = defects if suspicious else [*defects, *reasons]
        return arrays, reasons

    def _affords(self, contents: tuple[Content, Content]) -> bool:
        if self._unasked == MOST_PRODUCTS or None in map(self._contents.size, contents):
            return False
        self._unasked += 1
        return True

    def _read(
        self, stage: Stage, contents: tuple[Content, Content], descriptions: tuple[Description, Description]
    ) -> tuple[Arrays, str]:
        """Compare two products by their values, within the tolerances of the later one."""
        with tempfile.TemporaryDirectory(prefix="objectfolder-audit-") as folder:
            old, new = (Path(folder) / f"{side}{contents[0].suffix}" for side in (EARLIER, LATER))
            self._contents.place(contents[0], old)
            self._contents.place(contents[1], new)
            own_tolerances, own = stored_tolerances(stage.tolerances, descriptions[1], descriptions[0])
            arrays = Arrays.read(compare(old, new, own_tolerances))
        counts = arrays.count()
        if counts[DIFFERENT]:
            sentence = f"made from the same, beyond tolerance: {arrays.different()}"
        elif counts[WITHIN]:
            sentence = f"made from the same, {counts[WITHIN]} arrays within tolerance, {counts[EQUAL]} equal"
        else:
            sentence = "made from the same, arrays equal, packed otherwise"
        return arrays, sentence if own else f"{sentence}; tolerances as declared now, none are stored"


def _by_checksums(before: Description, after: Description) -> tuple[Arrays, list[Reason]]:
    """Compare two products by the checksums of their chunks; a damaged list of them is a defect.

    Two CRC-32 of different chunks of one size are equal once in four thousand million times, unless
    somebody wants them to be.
    """
    if not (before.listing and after.listing):
        return Arrays(unread=1), []
    chunks, damage = [], []
    for side, description in ((EARLIER, before), (LATER, after)):
        try:
            chunks.append(description.chunks)
        except ValueError as error:
            damage.append(_corrupted(side, error))
    if damage:
        return Arrays(unread=1), damage
    differing = {entry[2] for entry in chunks[0] ^ chunks[1]}
    names = {entry[2] for entry in chunks[0] | chunks[1]} - {GROUP.encode()}
    return Arrays({name.decode(): DIFFERENT if name in differing else EQUAL for name in sorted(names)}), []


def _corrupted(side: str, finding: object) -> Reason:
    return Reason(CORRUPTED, note=f"the {side} one: {finding}")
