"""The report of a data set: metrics, tables, pages and cards of the whole data set."""

import json
from pathlib import Path

from objectfolder.products.atomic import write_whole
from pipeline.dataset.failures import read_failures
from pipeline.dataset.measures import FULL_IMAGE, HEADLINE, number_at
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.publish.cards.croissant import croissant_text
from pipeline.publish.cards.data_card import card_text, citation_text
from pipeline.publish.cards.published_data_set import read_data_set
from pipeline.publish.report.writing import write_report
from pipeline.run.costs import costs_path
from pipeline.run.exclusive import exclusive

REPORTS = "reports"
# The headline figure of each sense, in words.
SUMMARISED = {
    "vision.psnr_foreground_db": "Sight:        PSNR of the foreground, held-out views,",
    "audio.gain_error_db": "Sound:        gain error at held-out points",
    "touch.psnr_contact_db": "Touch:        PSNR in contact, held-out touches,",
}


def make_report(root: Path) -> None:
    """Write the tables, the pages and the cards of the data set."""
    with exclusive(root, "stage report"):
        write_report(root / FIDELITY.folder, costs_path(root), root / REPORTS, read_failures(root))
        write_cards(root, root / REPORTS)
    print(f"Report: {REPORTS}/index.html")


def summary_of(root: Path) -> str:
    """Return how faithful the data set is by its last report, a line a sense, and how to look at it.

    Raises
    ------
    FileNotFoundError
        There is no report yet.
    """
    metrics = json.loads((root / REPORTS / "metrics.json").read_bytes())
    lines = []
    for measure in HEADLINE:
        title = SUMMARISED[measure.key]
        average, worst = (number_at(metrics, f"{measure.key}.{of}") for of in ("mean", "worst"))
        if average is None or worst is None:  # all failed, or all are silent
            lines.append(f"{title} none measured")
            continue
        line = f"{title} {average:.1f} dB in the mean, {worst:.1f} at worst"
        full = number_at(metrics, f"{FULL_IMAGE.key}.mean")
        if measure.sense == FULL_IMAGE.sense and full is not None:
            line += f" (of the full image {full:.1f} in the mean)"
        lines.append(line)
    files = sorted((root / OBJECT_FILES.folder).glob("*.safetensors"))
    look = [f"Look:         objectfolder view {files[0].relative_to(root)}"] if files else []
    return "\n".join(
        [*lines, f"Object Files: {OBJECT_FILES.folder}/", f"Report:       {REPORTS}/index.html", *look]
    )


def write_cards(root: Path, folder: Path) -> list[Path]:
    """Write croissant.json, data_card.md and CITATION.cff, each atomically; return their paths.

    Everything is a function of the Object Files, the reports in `folder`, ``data/records.json``,
    ``data/card.yaml``, ``params.yaml`` and what failed last: equal inputs give equal bytes.

    Without per_object.csv and metrics.json in `folder` the cards have no figures.

    Raises
    ------
    InputError
        See `read_data_set`.
    """
    data_set = read_data_set(root, folder)
    texts = {
        folder / "croissant.json": croissant_text(data_set, root, folder),
        folder / "data_card.md": card_text(data_set, root, folder),
        folder / "CITATION.cff": citation_text(data_set),
    }
    for path, text in texts.items():
        write_whole(path, text)
    return list(texts)
