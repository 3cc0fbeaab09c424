"""``.zenodo.json``: what Zenodo reads of a repository whose releases it archives."""

import html
import json
from typing import Any

from pipeline.publish.cards.data_card import TAGS
from pipeline.publish.cards.published_data_set import DataSet


def zenodo_text(data_set: DataSet) -> str:
    """Return Zenodo's metadata of a deposit.

    Its DOI is that of ``data/card.yaml``, empty before Zenodo gives one. Zenodo takes one licence: where
    objects have several, it is left out, and the data card names them.
    """
    publication = data_set.publication
    licences = {entry.licence.spdx for entry in data_set.objects}
    content: dict[str, Any] = {
        "upload_type": "dataset",
        "title": publication.title,
        "description": f"<p>{html.escape(data_set.description)}</p>",
        "version": data_set.version,
        "publication_date": str(publication.date or ""),
        "creators": [{"name": name} for name in publication.creators or ["anonymous"]],
        "keywords": list(TAGS),
        "license": licences.pop().lower() if len(licences) == 1 else "",
        "related_identifiers": [{"identifier": publication.url, "relation": "isDocumentedBy"}]
        if publication.url
        else "",
    }
    entries = {key: value for key, value in content.items() if value}
    return json.dumps({**entries, "doi": publication.doi}, indent=1, ensure_ascii=False) + "\n"
