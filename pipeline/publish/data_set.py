"""The report of a data set, and the data set with its report."""

import subprocess
import sys
from pathlib import Path

from pipeline.dataset.stages import FIDELITY, STAGES
from pipeline.run.costs import costs_path
from pipeline.run.stage_run import all_failures, converge_stages

REPORTS = "reports"


def make_report(root: Path) -> None:
    """Write the tables, the pages and the cards of the data set."""
    from pipeline.publish.cards.all_cards import write_cards
    from pipeline.publish.report.writing import write_report

    failures = [
        {"object": failure.object_id, "stage": stage, "error": failure.error, "remedy": failure.remedy}
        for stage, failure in all_failures(root)
    ]
    write_report(root / FIDELITY.folder, costs_path(root), root / REPORTS, failures)
    write_cards(root, root / REPORTS)


def make_dataset(root: Path) -> int:
    """Make all products with no barrier between stages, then let DVC see, report and record them."""
    dvc = [sys.executable, "-m", "dvc", "repro"]
    failed_before = bool(all_failures(root))
    code = subprocess.run([*dvc, "--quiet", "starter"], cwd=root, check=False).returncode
    if code:
        return code
    converge_stages(root, tuple(STAGES))
    if failed_before or all_failures(root):
        dvc.append("--force")  # what is finished is kept all the same
    return subprocess.run(dvc, cwd=root, check=False).returncode
