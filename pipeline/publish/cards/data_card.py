"""The cards that people read: Markdown whose front matter Hugging Face reads, and CITATION.cff."""

import html
import os
import re
from collections import Counter
from pathlib import Path
from typing import Any

import jinja2
import yaml

import objectfolder
from objectfolder.products.splits import OBJECT_SPLITS
from pipeline.dataset.counts import counted
from pipeline.dataset.measures import REPORTED, number_at
from pipeline.dataset.stages import STAGES
from pipeline.publish.cards.licences import Licence
from pipeline.publish.cards.published_data_set import LIMITS, PER_OBJECT, DataSet, PublishedObject

SOFTWARE = "ObjectFolder Factory"
SIZE_CATEGORIES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
TAGS = ("multisensory", "3d", "audio", "tactile", "robotics", "simulation", "objectfolder", "croissant")
_SPECIAL = re.compile(r"([\\`*_\[\]|~#])")


def card_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the card of a data set at `root` with reports in `folder`: equal data sets give equal bytes."""
    reports = Path(os.path.relpath(folder, root)).as_posix()
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "template"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"escape": escape, "yaml": _yaml}
    objects = data_set.objects
    costs = {
        stage: [float(text) for entry in objects if (text := entry.figures.get(f"cpu_seconds.{stage}"))]
        for stage in STAGES
    }
    return environment.get_template("data_card.md.j2").render(
        front=_front_matter(data_set, reports),
        data_set=data_set,
        counted=counted,
        materials=Counter(sorted(entry.material for entry in objects)).most_common(),
        licences=_licences(data_set),
        splits=OBJECT_SPLITS,
        measures=[
            measure for measure in REPORTED if number_at(data_set.metrics, f"{measure.key}.mean") is not None
        ],
        costs={stage: seconds for stage, seconds in costs.items() if seconds},
        limits=LIMITS,
        reports=reports,
    )


def escape(text: str) -> str:
    """Return one line of Markdown that reads as `text`, whatever stands in it; HTML in it does nothing."""
    return _SPECIAL.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))


def citation_text(data_set: DataSet) -> str:
    """Return CITATION.cff 1.2.0: the data set; as references its sources and the software that made it."""
    publication = data_set.publication
    spdx = {entry.licence.spdx for entry in data_set.objects}
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
    return _yaml({key: value for key, value in content.items() if value})


def _front_matter(data_set: DataSet, reports: str) -> dict[str, Any]:
    licences = [licence for licence, _ in _licences(data_set)]
    names = list(dict.fromkeys(licence.hugging_face for licence in licences))
    unnamed = [licence.label for licence in licences if licence.hugging_face == "other"]
    count = len(data_set.objects)
    table = {"config_name": "objects", "data_files": f"{reports}/{PER_OBJECT}", "default": True}
    front = {
        "pretty_name": data_set.publication.title,
        "license": names[0] if len(names) == 1 else names,
        "license_name": "; ".join(unnamed),
        "license_link": "#sources-licences-attributions" if unnamed else "",
        "size_categories": [next((name for most, name in SIZE_CATEGORIES if count < most), "n>1M")],
        "tags": list(TAGS),
        "configs": [table] if any(entry.figures for entry in data_set.objects) else [],
    }
    return {key: value for key, value in front.items() if value}


def _licences(data_set: DataSet) -> list[tuple[Licence, int]]:
    """Return every licence, the absence of one included, with its number of objects, most first."""
    return Counter(
        entry.licence for entry in sorted(data_set.objects, key=lambda entry: entry.licence.label)
    ).most_common()


def _yaml(content: Any, in_line: bool = False) -> str:
    text = yaml.safe_dump(
        content, sort_keys=False, allow_unicode=True, width=1000, default_flow_style=in_line
    )
    return text.strip()[1:-1] if in_line else text


def _reference(objects: list[PublishedObject]) -> dict[str, Any]:
    licence = objects[0].licence
    reference = {
        "type": "data",
        "title": objects[0].source or "Source not stated",
        "authors": [{"name": objects[0].attribution or "anonymous"}],
        "notes": f"{licence.label}; objects {', '.join(entry.id for entry in objects)}",
    }
    return reference | ({"license": licence.spdx} if licence.spdx else {})
