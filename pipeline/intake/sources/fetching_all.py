"""Many objects, one after another: one that fails does not stop the others."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.intake.sources.fetching import Fetched, Fetcher
from pipeline.intake.sources.http_client import UnreachableError
from pipeline.intake.sources.registry import Resolutions

MOST_UNREACHABLE = 2  # objects of a source in a row, after which its other objects are not asked for


@dataclass(frozen=True)
class Failed:
    """An object that was not fetched, by the id that was asked for, and why."""

    source_id: str
    error: ObjectFolderError


def fetch_all(
    fetcher: Fetcher,
    source_ids: Sequence[str],
    resolutions: Resolutions,
    begin: Callable[[str], None] = lambda source_id: None,
) -> Iterator[Fetched | Failed]:
    """Yield the outcome of each object.

    Parameters
    ----------
    source_ids
        As ``ycb:025_mug``; each once.
    resolutions
        Which, by source.
    begin
        Called before each.
    """
    unreachable: Counter[str] = Counter()
    for source_id in dict.fromkeys(source_ids):
        try:
            asked = resolutions.asked(source_id)
            source = asked.source.id
            if unreachable[source] >= MOST_UNREACHABLE:
                finding = "not tried, for its source cannot be reached"
                raise InputError(source_id, finding, "Run the same command later.")
            begin(source_id)
            try:
                fetched = fetcher.fetch(asked)
            except ObjectFolderError as error:
                is_unreachable = isinstance(error, UnreachableError)
                unreachable[source] = unreachable[source] + 1 if is_unreachable else 0
                raise
            unreachable[source] = 0
            yield fetched
        except ObjectFolderError as error:
            yield Failed(source_id, error)
