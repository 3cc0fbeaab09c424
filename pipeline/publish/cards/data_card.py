"""The data set card: Markdown whose front matter Hugging Face reads."""

import os
import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from objectfolder.splits import OBJECT_SPLITS
from pipeline.dataset.measures import HEADLINE
from pipeline.dataset.stages import STAGES
from pipeline.publish.cards.credited_sources import licences, sources
from pipeline.publish.cards.data_set import DataSet
from pipeline.publish.cards.markdown import escape, table
from pipeline.publish.cards.statements import LIMITS, citation, counted, description, materials

SIZE_CATEGORIES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


def card_text(data_set: DataSet, root: Path, folder: Path) -> str:
    """Return the card of a data set at `root` with reports in `folder`: equal data sets give equal bytes."""
    reports = Path(os.path.relpath(folder, root)).as_posix()
    front = yaml.safe_dump(_front_matter(data_set, reports), sort_keys=False, allow_unicode=True, width=1000)
    sections = [
        [f"# {escape(data_set.publication.title)}", "", escape(description(data_set))],
        _content(data_set),
        _splits(data_set),
        _fidelity(data_set),
        _cost(data_set),
        _terms(data_set),
        ["## Known limits", "", *(f"- {limit}" for limit in LIMITS)],
        _missing(data_set),
        _use(data_set, reports),
        ["## Citation", "", escape(citation(data_set)), "", "`CITATION.cff` here names all sources."],
    ]
    body = "\n\n".join("\n".join(section) for section in sections if section)
    return f"---\n{front}---\n\n{body}\n"


def _front_matter(data_set: DataSet, reports: str) -> dict[str, Any]:
    known = licences(data_set)
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
    front["tags"] = [
        "multisensory",
        "3d",
        "audio",
        "tactile",
        "robotics",
        "simulation",
        "objectfolder",
        "croissant",
    ]
    if data_set.figures_file:
        path = f"{reports}/{data_set.figures_file.path}"
        front["configs"] = [{"config_name": "objects", "data_files": path, "default": True}]
    return front


def _content(data_set: DataSet) -> list[str]:
    sizes = [entry.file.bytes for entry in data_set.objects]
    held = [
        f"- **Version** {data_set.version}; the part after `+` is a digest of all Object Files.",
        f"- **{counted(len(sizes), 'object')}** of {counted(len(materials(data_set)), 'material')}: "
        + ", ".join(f"{escape(name)} {count}" for name, count in materials(data_set))
        + ".",
    ]
    if sizes:
        mean = round(statistics.fmean(sizes))
        held.append(
            f"- **Object Files**: {_megabytes(sum(sizes))} in all; mean {_megabytes(mean)}, "
            f"least {_megabytes(min(sizes))}, largest {_megabytes(max(sizes))}. "
            "One safetensors file an object: surface, reflectance, modes, sensor, description of itself."
        )
    held += [
        f"- **Made with** the parameters of size `{data_set.size}` of `params.yaml`, seed {data_set.seed}:",
        *(f"  - {sense}: `{_pairs(values)}`" for sense, values in sorted(data_set.parameters.items())),
        "- **Files** of the repository: `data/object_files/ID.safetensors`; the ground truth they were "
        "fitted to and measured on in `data/views`, `data/modes` and `data/touches`, Zarr 3 archives with "
        "dimensions and units; meshes in `data/objects`.",
    ]
    return ["## What is in it", "", *held]


def _splits(data_set: DataSet) -> list[str]:
    members = {
        name: [entry.object_id for entry in data_set.objects if entry.split == name] for name in OBJECT_SPLITS
    }
    rows = [
        (name, str(len(ids)), ", ".join(f"`{object_id}`" for object_id in ids) or "none in this data set")
        for name, ids in members.items()
    ]
    return [
        "## Splits",
        "",
        "Within an object: the array `held_out` of each product of ground truth says which views, surface "
        "points and touches no encoder was fitted to. All fidelity here is on those.",
        "",
        "Across objects: by SHA-256 of a rule's name, material and id, about 80, 10 and 10 of 100 "
        "(`objectfolder.splits.object_split`). Adding objects moves no other.",
        "",
        *table(("split", "objects", "ids"), rows),
    ]


def _fidelity(data_set: DataSet) -> list[str]:
    rows, definitions = [], []
    for measure in HEADLINE:
        found = data_set.metrics.get(measure.sense, {}).get(measure.name, {})
        if found.get("mean") is None:
            continue
        numbers = [f"{found[key]:.{measure.decimals}f}" for key in ("mean", "worst")]
        unit = f" ({measure.unit})" if measure.unit else ""
        rows.append((f"{measure.sense}: {measure.label}{unit}", *numbers))
        meaning = data_set.definitions.get(measure.key, measure.definition)
        definitions.append(f"- **{measure.label}** (`{measure.key}`): {escape(meaning)}")
    if not rows:
        return ["## Fidelity", "", "Not measured."]
    silent = data_set.metrics.get("audio", {}).get("silent_objects") or 0
    if silent:
        text = f"- {counted(silent, 'object')} without an audible mode: not in the means of audio."
        definitions.append(text)
    return [
        "## Fidelity",
        "",
        "Object File against simulated truth, on held-out queries; all figures are in `per_object.csv`.",
        "",
        *table(("measure", "mean over objects", "worst object"), rows),
        "",
        *definitions,
    ]


def _cost(data_set: DataSet) -> list[str]:
    rows = []
    for stage in STAGES:
        seconds = [
            float(text)
            for entry in data_set.objects
            if (text := entry.figures.get(f"cpu_seconds.{stage}", ""))
        ]
        if seconds:
            rows.append((stage, str(len(seconds)), f"{statistics.fmean(seconds):.1f}", f"{max(seconds):.1f}"))
    if not rows:
        return []
    return [
        "## Cost",
        "",
        "CPU seconds where they were measured, of the machine that made the data set.",
        "",
        *table(("stage", "objects measured", "mean CPU-s an object", "most"), rows),
    ]


def _terms(data_set: DataSet) -> list[str]:
    counts = [
        (f"[{escape(licence.label)}]({licence.url})" if licence.spdx else escape(licence.label), str(count))
        for licence, count in licences(data_set)
    ]
    unstated = sum(not entry.licence.stated for entry in data_set.objects)
    groups = [
        f"- {escape(group.source) or 'source not stated'}; {escape(group.licence.label)}; "
        f"attribution: {escape(group.attribution) or 'not stated'}. "
        f"{counted(len(group.object_ids), 'object')}: "
        + ", ".join(f"`{object_id}`" for object_id in group.object_ids)
        for group in sources(data_set)
    ]
    warning = f"**No licence is stated for {counted(unstated, 'object')}.** Ask the source before using them."
    return [
        "## Sources, licences, attributions",
        "",
        "An Object File has the shape and colours of its mesh in it: the licence of the mesh stays with it.",
        "",
        *table(("licence", "objects"), counts),
        "",
        *([warning, ""] if unstated else []),
        *groups,
    ]


def _missing(data_set: DataSet) -> list[str]:
    if not data_set.missing:
        return []
    lines = [
        f"- `{entry.object_id}`{f', stage {entry.stage}' if entry.stage else ''}: {escape(entry.error)}"
        for entry in data_set.missing
    ]
    return [
        "## Not made",
        "",
        f"{counted(len(lines), 'listed object')} have no Object File here.",
        "",
        *lines,
    ]


def _use(data_set: DataSet, reports: str) -> list[str]:
    example = data_set.objects[0].object_id if data_set.objects else "ID"
    return [
        "## Use",
        "",
        "```console",
        f"objectfolder get REPOSITORY {example} -o objects  # REPOSITORY: path or URL of this one",
        "```",
        "",
        "```python",
        "import objectfolder",
        "",
        f'file = objectfolder.load("objects/{example}.safetensors")',
        "images = file.render(*file.sample_views(4, seed=0))",
        "```",
        "",
        f"Figures: `{reports}/per_object.csv`. For machines: `{reports}/croissant.json` (Croissant 1.1).",
    ]


def _megabytes(count: int) -> str:
    return f"{count / 1e6:.2f} MB"


def _pairs(values: Any) -> str:
    if not isinstance(values, dict):
        return str(values)
    return ", ".join(f"{key} {_pairs(value)}" for key, value in _flat(values))


def _flat(values: dict[str, Any], prefix: str = "") -> Sequence[tuple[str, Any]]:
    flat: list[tuple[str, Any]] = []
    for key, value in values.items():
        if isinstance(value, dict):
            flat += _flat(value, f"{prefix}{key}.")
        else:
            flat.append((f"{prefix}{key}", value))
    return flat
