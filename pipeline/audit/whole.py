"""Products read whole where what they say is not enough: made from the same and yet of other bytes."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from objectfolder.errors import FormatError, ObjectFolderError
from pipeline.audit.arrays import Arrays, by_reading, stored_tolerances
from pipeline.audit.contents import Content, Contents
from pipeline.audit.descriptions import Description
from pipeline.audit.reasons import BYTES, CORRUPTED, UNREADABLE, Reason
from pipeline.audit.reproducibility import DIFFERENT, EQUAL, WITHIN
from pipeline.dataset import products
from pipeline.dataset.stage import Stage

# What is read without being asked to, in all: the few products that contradict themselves.
MOST_PRODUCTS = 32
MOST_BYTES = 256 << 20
ASK = "made from the same, other bytes: --arrays reads them"


class Suspects:
    """Reads products whole, within bounds unless it was asked for.

    Parameters
    ----------
    contents
        Where they are read from.
    read_arrays
        Whether it was asked for; then what is far is fetched, too.
    """

    def __init__(self, contents: Contents, read_arrays: bool) -> None:
        self.read_arrays = read_arrays
        self._contents = contents
        self._products, self._bytes = MOST_PRODUCTS, MOST_BYTES

    def compare(
        self, stage: Stage, old: Content, new: Content, before: Description, after: Description
    ) -> tuple[Arrays | None, list[Reason]]:
        """Return how the arrays of two products compare, and what is wrong with either.

        Parameters
        ----------
        stage
            Which makes them.
        old, new
            The products.
        before, after
            What they say.

        Returns
        -------
        tuple
            None where they were not read, and the reasons: one that they were not, that one is corrupted,
            or that both are whole and how they differ.
        """
        if not self._affords(old, new):
            return None, [Reason(BYTES, note=ASK)] if before.fingerprint == after.fingerprint else []
        try:
            with self._file(old, "earlier") as first, self._file(new, "later") as second:
                damaged = [
                    Reason(CORRUPTED, note=f"the {which} one: {finding}")
                    for which, path in (("earlier", first), ("later", second))
                    if (finding := _damage(path))
                ]
                if damaged:
                    return None, damaged
                allowed, stored = stored_tolerances(stage, after, before)
                found = by_reading(first, second, allowed)
        except FormatError as error:
            return None, [Reason(CORRUPTED, note=error.finding)]
        except ObjectFolderError as error:
            return None, [Reason(UNREADABLE, note=error.finding)]
        if before.fingerprint != after.fingerprint:
            return found, []
        return found, [Reason(BYTES, note=_sentence(found, stored))]

    def _affords(self, old: Content, new: Content) -> bool:
        if self.read_arrays:
            return True
        sizes = [self._contents.size(one) for one in (old, new)]
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
            near = self._contents.near(content)
            if near is not None:
                path.symlink_to(near.resolve())
            else:
                self._contents.fetch(content.md5, path, content.where)
            yield path


def _damage(path: Path) -> str:
    try:
        products.verify(path)
    except FormatError as error:
        return error.finding
    except FileNotFoundError:
        return "it is gone"
    return ""


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
