"""The data set card: Markdown whose front matter Hugging Face reads, from ``template/data_card.md.j2``."""

import html
import os
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jinja2
import yaml

from objectfolder.splits import OBJECT_SPLITS
from pipeline.dataset.measures import HEADLINE, Measure
from pipeline.dataset.stages import STAGES
from pipeline.publish.cards.published_data_set import DataSet
from pipeline.publish.cards.statements import LIMITS, citation, counted, description, materials

TEMPLATES = Path(__file__).parent / "template"
SIZE_CATEGORIES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
TAGS = ("multisensory", "3d", "audio", "tactile", "robotics", "simulation", "objectfolder", "croissant")
_SPECIAL = re.compile(r"([\\`*_\[\]|~#])")


def card_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the card of a data set at `root` with reports in `folder`: equal data sets give equal bytes."""
    reports = Path(os.path.relpath(folder, root)).as_posix()
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"escape": escape, "megabytes": _megabytes, "ids": _ids}
    objects = data_set.objects
    sizes = [entry.file.bytes for entry in objects]
    return environment.get_template("data_card.md.j2").render(
        front=yaml.safe_dump(
            _front_matter(data_set, reports), sort_keys=False, allow_unicode=True, width=1000
        ),
        data_set=data_set,
        publication=data_set.publication,
        description=description(data_set),
        citation=citation(data_set),
        counted=counted,
        materials=materials(data_set),
        sizes=sizes,
        mean_bytes=round(statistics.fmean(sizes)) if sizes else 0,
        parameters=[(sense, _pairs(values)) for sense, values in sorted(data_set.parameters.items())],
        splits=[(name, [one.object_id for one in objects if one.split == name]) for name in OBJECT_SPLITS],
        fidelity=list(_fidelity(data_set)),
        silent=data_set.metrics.get("audio", {}).get("silent_objects") or 0,
        costs=list(_costs(data_set)),
        licences=data_set.licences(),
        sources=data_set.sources(),
        unstated=sum(not entry.licence.stated for entry in objects),
        limits=LIMITS,
        example=objects[0].object_id if objects else "ID",
        reports=reports,
    )


def escape(text: str) -> str:
    """Return one line of Markdown that reads as `text`, whatever stands in it; HTML in it does nothing."""
    return _SPECIAL.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))


def _front_matter(data_set: DataSet, reports: str) -> dict[str, Any]:
    known = data_set.licences()
    names = list(dict.fromkeys(licence.hugging_face for licence, _ in known))
    front: dict[str, Any] = {"pretty_name": data_set.publication.title}
    if names:
        front["license"] = names[0] if len(names) == 1 else names
    if "other" in names:
        others = [licence.label for licence, _ in known if licence.hugging_face == "other"]
        front["license_name"] = "; ".join(others)
        front["license_link"] = "#sources-licences-attributions"
    count = len(data_set.objects)
    front["size_categories"] = [next((name for most, name in SIZE_CATEGORIES if count < most), "n>1M")]
    front["tags"] = list(TAGS)
    if data_set.figures_file:
        path = f"{reports}/{data_set.figures_file.path}"
        front["configs"] = [{"config_name": "objects", "data_files": path, "default": True}]
    return front


def _fidelity(data_set: DataSet) -> Iterator[tuple[Measure, str, str]]:
    """Yield each measure that was measured, with its mean and worst value."""
    for measure in HEADLINE:
        found = data_set.metrics.get(measure.sense, {}).get(measure.name, {})
        if found.get("mean") is not None:
            mean, worst = (f"{found[key]:.{measure.decimals}f}" for key in ("mean", "worst"))
            yield measure, mean, worst


def _costs(data_set: DataSet) -> Iterator[tuple[str, list[float]]]:
    """Yield each stage whose CPU seconds were measured, with those of the objects."""
    for stage in STAGES:
        texts = [entry.figures.get(f"cpu_seconds.{stage}", "") for entry in data_set.objects]
        if seconds := [float(text) for text in texts if text]:
            yield stage, seconds


def _ids(object_ids: Iterable[str]) -> str:
    return ", ".join(f"`{object_id}`" for object_id in object_ids)


def _megabytes(count: int) -> str:
    return f"{count / 1e6:.2f} MB"


def _pairs(values: Any) -> str:
    if not isinstance(values, Mapping):
        return str(values)
    return ", ".join(f"{key} {value}" for key, value in _flat(values))


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
