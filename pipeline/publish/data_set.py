"""What the last report says of the whole data set: in lines, and in its cards."""

import json
from dataclasses import dataclass
from pathlib import Path

from objectfolder.products.atomic import write_whole
from pipeline.dataset.measures import FULL_IMAGE, HEADLINE, number_at
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.dataset.verified import Verified
from pipeline.publish.cards.croissant import croissant_text
from pipeline.publish.cards.data_card import card_text, citation_text
from pipeline.publish.cards.published_data_set import read_data_set

REPORTS = "reports"
SUMMARIES = {measure.key: measure.summary for measure in HEADLINE}


@dataclass(frozen=True, kw_only=True)
class Headline:
    """A measure over the objects that have it, in its unit; None where none has."""

    measure: str
    mean: float | None
    worst: float | None


@dataclass(frozen=True, kw_only=True)
class DataSetSummary:
    """How faithful a data set is by its last report, and where it is; ``str`` words it in lines.

    Parameters
    ----------
    headlines
        One of each sense.
    full_image_db
        Mean PSNR of the full image.
    object_files
        Folder of the Object Files.
    report
        First page of the report.
    first
        The first Object File, to look at.
    """

    headlines: tuple[Headline, ...]
    full_image_db: float | None
    object_files: str
    report: str
    first: str | None

    def __str__(self) -> str:
        lines = []
        for headline in self.headlines:
            title = SUMMARIES[headline.measure]
            if headline.mean is None or headline.worst is None:  # all failed, or all are silent
                lines.append(f"{title} none measured")
                continue
            line = f"{title} {headline.mean:.1f} dB in the mean, {headline.worst:.1f} at worst"
            if headline.measure.startswith(f"{FULL_IMAGE.sense}.") and self.full_image_db is not None:
                line += f" (of the full image {self.full_image_db:.1f} in the mean)"
            lines.append(line)
        lines += [f"Object Files: {self.object_files}/", f"Report:       {self.report}"]
        if self.first:
            lines.append(f"Look:         objectfolder view {self.first}")
        return "\n".join(lines)


def summary_of(root: Path) -> DataSetSummary:
    """Return how faithful the data set is by its last report.

    Raises
    ------
    FileNotFoundError
        There is no report yet.
    """
    metrics = json.loads((root / REPORTS / "metrics.json").read_bytes())
    files = sorted((root / OBJECT_FILES.folder).glob("*.safetensors"))
    return DataSetSummary(
        headlines=tuple(
            Headline(
                measure=measure.key,
                mean=number_at(metrics, f"{measure.key}.mean"),
                worst=number_at(metrics, f"{measure.key}.worst"),
            )
            for measure in HEADLINE
        ),
        full_image_db=number_at(metrics, f"{FULL_IMAGE.key}.mean"),
        object_files=str(OBJECT_FILES.folder),
        report=f"{REPORTS}/index.html",
        first=str(files[0].relative_to(root)) if files else None,
    )


def write_cards(root: Path, folder: Path, states: Verified | None = None) -> list[Path]:
    """Write croissant.json, data_card.md and CITATION.cff, each atomically; return their paths.

    Everything is a function of the Object Files, the reports in `folder`, ``data/records.json``,
    ``data/card.yaml``, ``params.yaml`` and what failed last: equal inputs give equal bytes.

    Without per_object.csv and metrics.json in `folder` the cards have no figures.

    Raises
    ------
    InputError
        See `read_data_set`.
    """
    data_set = read_data_set(root, folder, states)
    texts = {
        folder / "croissant.json": croissant_text(data_set, root, folder),
        folder / "data_card.md": card_text(data_set, root, folder),
        folder / "CITATION.cff": citation_text(data_set),
    }
    for path, text in texts.items():
        write_whole(path, text)
    return list(texts)
