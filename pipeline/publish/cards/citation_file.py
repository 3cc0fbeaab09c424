"""CITATION.cff of a data set (https://citation-file-format.github.io, version 1.2.0)."""

from typing import Any

import yaml

import objectfolder
from pipeline.publish.cards.published_data_set import DataSet, Source
from pipeline.publish.cards.statements import description

SOFTWARE = "ObjectFolder Factory"


def citation_text(data_set: DataSet) -> str:
    """Return the file: the data set, and as references its sources and the software that made it."""
    publication = data_set.publication
    # The format wants an author; it knows this name for those who are not known.
    authors = [{"name": name} for name in publication.creators] or [{"name": "anonymous"}]
    spdx = sorted({entry.licence.spdx for entry in data_set.objects})
    content: dict[str, Any] = {
        "cff-version": "1.2.0",
        "message": "If you use this data set, please cite it and the sources of its objects.",
        "type": "dataset",
        "title": publication.title,
        "abstract": description(data_set),
        "version": data_set.version,
        "authors": authors,
    }
    optional = {"date-released": publication.date, "url": publication.url, "doi": publication.doi}
    content |= {key: value for key, value in optional.items() if value}
    if spdx and all(spdx):  # a list would let a reader choose; here each holds for other objects
        content |= {"license": spdx[0]} if len(spdx) == 1 else {}
    content["references"] = [
        {
            "type": "software",
            "title": SOFTWARE,
            "version": objectfolder.__version__,
            "authors": [{"name": f"{SOFTWARE} contributors"}],
        },
        *(_reference(group) for group in data_set.sources()),
    ]
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True, width=1000)


def _reference(group: Source) -> dict[str, Any]:
    reference: dict[str, Any] = {
        "type": "data",
        "title": group.source or "Source not stated",
        "authors": [{"name": group.attribution or "anonymous"}],
        "notes": f"{group.licence.label}; objects {', '.join(group.object_ids)}",
    }
    if group.licence.spdx:
        reference["license"] = group.licence.spdx
    return reference
