"""Many objects, one after another: one that fails does not stop the others."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from objectfolder.errors import InputError, ObjectFolderError
from pipeline.intake.sources.fetching import Fetched, Fetcher
from pipeline.intake.sources.registry import Resolutions
from pipeline.intake.sources.web import Transient

MOST_UNREACHABLE = 2  # objects of a source in a row, after which the rest of it is not waited for


@dataclass(frozen=True)
class Failed:
    """An object that was not fetched.

    Parameters
    ----------
    source_id
        As it was asked for.
    error
        Why.
    """

    source_id: str
    error: ObjectFolderError


def fetch_all(
    fetcher: Fetcher,
    source_ids: Sequence[str],
    resolutions: Resolutions,
    begin: Callable[[str], None] = lambda source_id: None,
) -> Iterator[Fetched | Failed]:
    """Yield what became of each object, an object at a time.

    Parameters
    ----------
    source_ids
        As ``ycb:025_mug``; each once.
    resolutions
        Which, by source.
    begin
        Called before each.
    """
    unreachable: dict[str, int] = {}
    for source_id in dict.fromkeys(source_ids):
        try:
            asked = resolutions.asked(source_id)
            if unreachable.get(asked.source.id, 0) >= MOST_UNREACHABLE:
                raise InputError(
                    source_id,
                    "not tried, for its source cannot be reached",
                    "The same command goes on later.",
                )
            begin(source_id)
            try:
                fetched = fetcher.fetch(asked)
            except ObjectFolderError as error:
                is_network = isinstance(error.__cause__, Transient)
                unreachable[asked.source.id] = unreachable.get(asked.source.id, 0) + 1 if is_network else 0
                raise
            unreachable[asked.source.id] = 0
            yield fetched
        except ObjectFolderError as error:
            yield Failed(source_id, error)
