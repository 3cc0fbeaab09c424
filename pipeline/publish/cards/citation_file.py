"""CITATION.cff of a data set (https://citation-file-format.github.io, version 1.2.0)."""

from typing import Any

import yaml

import objectfolder
from pipeline.publish.cards.published_data_set import DataSet, PublishedObject

SOFTWARE = "ObjectFolder Factory"


def citation_text(data_set: DataSet) -> str:
    """Return the file: the data set, and as references its sources and the software that made it."""
    publication = data_set.publication
    spdx = {one.licence.spdx for one in data_set.objects}
    software = {
        "type": "software",
        "title": SOFTWARE,
        "version": objectfolder.__version__,
        "authors": [{"name": f"{SOFTWARE} contributors"}],
    }
    content: dict[str, Any] = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it and the sources of its objects.",
        "type": "dataset",
        "title": publication.title,
        "abstract": data_set.description,
        "version": data_set.version,
        # The format wants an author; it knows this name for those who are not known.
        "authors": [{"name": name} for name in publication.creators or ["anonymous"]],
        "date-released": str(publication.date or ""),
        "url": publication.url,
        "doi": publication.doi,
        # Of a list a reader could choose; here each holds for other objects.
        "license": spdx.pop() if len(spdx) == 1 else "",
        "references": [software, *map(_reference, data_set.sources())],
    }
    stated = {key: value for key, value in content.items() if value}
    return yaml.safe_dump(stated, sort_keys=False, allow_unicode=True, width=1000)


def _reference(objects: list[PublishedObject]) -> dict[str, Any]:
    licence = objects[0].licence
    reference = {
        "type": "data",
        "title": objects[0].source or "Source not stated",
        "authors": [{"name": objects[0].attribution or "anonymous"}],
        "notes": f"{licence.label}; objects {', '.join(one.id for one in objects)}",
    }
    return reference | ({"license": licence.spdx} if licence.spdx else {})
