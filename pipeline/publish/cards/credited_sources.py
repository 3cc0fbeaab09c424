"""Sources, licences and attributions, collected from all objects and grouped."""

from dataclasses import dataclass

from pipeline.publish.cards.licences import Licence
from pipeline.publish.cards.published_data_set import DataSet


@dataclass(frozen=True)
class Source:
    """Objects of one origin under one licence with one attribution; empty text is what was not stated."""

    source: str
    licence: Licence
    attribution: str
    object_ids: tuple[str, ...]


def sources(data_set: DataSet) -> list[Source]:
    """Return every source once, most objects first; each object is in exactly one."""
    groups: dict[tuple[str, Licence, str], list[str]] = {}
    for entry in data_set.objects:
        groups.setdefault((entry.source, entry.licence, entry.attribution), []).append(entry.object_id)
    made = [Source(*key, tuple(sorted(ids))) for key, ids in groups.items()]
    return sorted(
        made, key=lambda group: (-len(group.object_ids), group.source, group.licence.label, group.attribution)
    )


def licences(data_set: DataSet) -> list[tuple[Licence, int]]:
    """Return every licence, the absence of one included, with its number of objects, most objects first."""
    counts: dict[Licence, int] = {}
    for entry in data_set.objects:
        counts[entry.licence] = counts.get(entry.licence, 0) + 1
    return sorted(counts.items(), key=lambda item: (-item[1], item[0].label))
