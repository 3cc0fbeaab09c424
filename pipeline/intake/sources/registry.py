"""The sources that are known: those of the project, and those of plugins (docs/extending.md)."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from objectfolder.errors import InputError
from objectfolder.plugins import SOURCE_GROUP as GROUP
from objectfolder.plugins import Plugin, find_plugin, plugin_names
from pipeline.dataset.catalogue import read_rows
from pipeline.dataset.validation import did_you_mean
from pipeline.intake.sources.google_scanned_objects import GoogleScannedObjects
from pipeline.intake.sources.poly_haven import PolyHaven
from pipeline.intake.sources.source import Source, SourceObject
from pipeline.intake.sources.ycb import YCB

SOURCES: Mapping[str, Source] = {source.id: source for source in (YCB(), GoogleScannedObjects(), PolyHaven())}


def source_ids() -> list[str]:
    """Return the ids of all sources; no plugin is imported."""
    return [*SOURCES, *plugin_names(GROUP)]


def source_named(name: str) -> Source:
    """Return a source by its id.

    Raises
    ------
    InputError
        No such source, with the nearest one; or a plugin that brings none.
    """
    plugin = find_plugin(GROUP, name, SOURCES)
    if plugin is not None:
        return _source_of(plugin)
    if name in SOURCES:
        return SOURCES[name]
    remedy = did_you_mean(name.casefold(), source_ids(), f"There are {', '.join(source_ids())}.")
    raise InputError(name, "no such source", remedy)


def _source_of(plugin: Plugin) -> Source:
    """Return the source of a plugin, all of whose attributes are there."""
    try:
        source = plugin.part()
    except TypeError as error:
        raise plugin.error(f"makes no source ({error})", "Let it name a subclass of Source.") from error
    absent = [name for name in Source.__annotations__ if not hasattr(source, name)]
    if not isinstance(source, Source) or absent:
        finding = f"lacks {', '.join(absent)}" if absent else "is no source"
        raise plugin.error(finding, "Let it name a subclass of Source with all attributes.")
    if source.id != plugin.name:
        raise plugin.error(f"has the id {source.id!r}", "Give the entry point and the source one name.")
    return source


def source_and_name(source_id: str) -> tuple[Source, str]:
    """Return the source of ``ycb:025_mug``, and ``025_mug``.

    Raises
    ------
    InputError
        It does not begin with a source.
    """
    start, colon, name = source_id.partition(":")
    if not colon:
        raise InputError(
            source_id,
            "does not say of which source it is",
            f"Write it as {SOURCES['ycb'].source_id('025_mug')}; there are {', '.join(source_ids())}.",
        )
    return source_named(start), name


def mirrored_addresses(mirrors: Iterable[str]) -> dict[str, str]:
    """Return starts of addresses and what stands in their place, for a `download.Downloader`.

    Parameters
    ----------
    mirrors
        Each ``ycb=http://host/folder``, under which all of a source is, laid out as there; or
        ``https://start/of/addresses/=http://host/``.

    Raises
    ------
    InputError
        No ``=``, an unknown source, or what stands in place is no http address.
    """
    new: dict[str, str] = {}
    for text in mirrors:
        of, _, address = text.rpartition("=") if "://" in text.partition("=")[0] else text.partition("=")
        if not of or not address.startswith(("http://", "https://")):
            raise InputError(
                f"mirror {text!r}",
                "is not of the form SOURCE=http://...",
                "Write it as ycb=http://localhost:8000/ycb",
            )
        starts = (of,) if "://" in of else source_named(of).addresses
        for start in starts:
            new[start] = address.rstrip("/") + "/" if start.endswith("/") else address
    return new


class Resolutions:
    """What resolution is asked of each source.

    Parameters
    ----------
    texts
        Each ``SOURCE=RESOLUTION``, or a resolution, which is for every source that has it.

    Raises
    ------
    InputError
        No such source, or no source has the resolution.
    """

    def __init__(self, texts: Sequence[str] = ()) -> None:
        self._choices: list[tuple[str | None, str]] = []
        for text in texts:
            of, equals, resolution = text.rpartition("=")
            self._choices.append((of if equals else None, resolution))
            listing = []
            # A plugin is imported only where no source before it has the resolution.
            for source in map(source_named, [of] if equals else source_ids()):
                listing.append(f"{source.id}: {', '.join(source.resolutions)}")
                if resolution in source.resolutions:
                    break
            else:
                remedy = f"There are {'; '.join(listing)}."
                raise InputError(f"--resolution {text}", "no such resolution", remedy)

    def source_object(self, source_id: str) -> SourceObject:
        """Return what an id asks for; InputError for an id that no source can have."""
        source, name = source_and_name(source_id)
        source.check_name(name)
        resolution = source.resolutions[0]
        for of, choice in self._choices:
            if of in (None, source.id) and choice in source.resolutions:
                resolution = choice
        return SourceObject(source, name, resolution)


def table_ids(table: Path, only: Collection[str] = ()) -> list[str]:
    """Return the `source_id` of the rows of a table that have one, of those with the ids `only`, if any.

    Raises
    ------
    InputError
        No table of objects, no column `source_id`, or an id of `only` that is not there or has none.
    """
    columns, rows = read_rows(table)
    if "source_id" not in columns:
        remedy = "Add it: source_id says where from, as ycb:025_mug"
        raise InputError(str(table), "has no column 'source_id'", remedy)
    ids = {row["id"]: row["source_id"] for _, row in rows}
    for object_id in only:
        if object_id not in ids:
            remedy = did_you_mean(object_id, ids, "Use an id of the table.")
            raise InputError(str(table), f"there is no object {object_id!r}", remedy)
        if not ids[object_id]:
            raise InputError(
                f"{table}, {object_id}",
                "has no source_id",
                "Fill in its source_id, or leave it out: its files cannot be fetched.",
            )
    return [row["source_id"] for _, row in rows if row["source_id"] and (not only or row["id"] in only)]
