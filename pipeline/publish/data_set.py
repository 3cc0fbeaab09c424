"""The report of a data set: metrics, tables, pages and cards of the whole data set."""

from pathlib import Path

from pipeline.dataset.failures import read_failures
from pipeline.dataset.stages import FIDELITY, OBJECT_FILES
from pipeline.publish.cards.all_cards import write_cards
from pipeline.publish.report.writing import write_report
from pipeline.run.costs import costs_path
from pipeline.run.exclusive import running

REPORTS = "reports"


def make_report(root: Path) -> int:
    """Write the tables, the pages and the cards of the data set, and say where they are."""
    with running(root, "stage report"):
        write_report(root / FIDELITY.folder, costs_path(root), root / REPORTS, read_failures(root))
        write_cards(root, root / REPORTS)
    print(f"Object Files: {OBJECT_FILES.folder}/\nReport:       {REPORTS}/index.html")
    return 0
