"""``python -m pipeline STAGE``: what ``dvc.yaml`` runs, and the few commands around it."""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from objectfolder.errors import ObjectFolderError
from pipeline import selection
from pipeline.cluster import crew, read_place
from pipeline.converge import converge
from pipeline.parameters import read_parameters
from pipeline.progress import failure_table
from pipeline.records import read_records, read_table, write_records
from pipeline.run_log import costs_path, read_failures
from pipeline.stages import FIDELITY, OBJECT_FILES, STAGES
from pipeline.task import Failure

PARAMETERS = "params.yaml"
STARTER = "data/starter"
REPORTS = "reports"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command in the current folder; return its exit code."""
    options = _parser().parse_args(arguments)
    root = Path.cwd()
    try:
        if options.command in STAGES:
            return converge_stages(root, [options.command])
        if options.command == "products":
            return converge_stages(root, list(STAGES))
        if options.command == "starter":
            return make_starter_set(root)
        if options.command == "report":
            return make_report(root)
        if options.command == "select":
            changes = selection.select(root / PARAMETERS, options.objects, options.only)
            print("\n".join(changes))
            return 0
        if options.command == "dataset":
            return make_dataset(root)
        return show_failures(root)
    except ObjectFolderError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: nothing finished is lost, the next run does what is left", file=sys.stderr)
        return 130


def converge_stages(root: Path, names: Sequence[str]) -> int:
    """Converge stages over all objects; return 1 where one does not stand."""
    parameters = read_parameters(root / PARAMETERS)
    if "objects" in names:
        records = read_table(root, parameters.objects)
        write_records(root, records)
    else:
        records = read_records(root)
    place = read_place(root)
    stages = [STAGES[name] for name in names]
    summaries = converge(
        stages,
        root,
        parameters,
        records.rows,
        lambda jobs: crew(place, root, jobs, stages),
        records.refused if "objects" in names else (),
    )
    return max(summary.exit_code(parameters.allow_failures) for summary in summaries)


def make_starter_set(root: Path) -> int:
    """Write the meshes and textures of the starter set."""
    from objectfolder.geometry.starter.write import write_starter_set

    write_starter_set(root / STARTER)
    return 0


def make_report(root: Path) -> int:
    """Write the tables and the page of the data set."""
    from pipeline.report import write_report

    failures = [
        {"object": failure.object_id, "stage": stage, "error": failure.error, "remedy": failure.remedy}
        for stage, failure in all_failures(root)
    ]
    write_report(root / FIDELITY.folder, costs_path(root), root / REPORTS, failures)
    return 0


def make_dataset(root: Path) -> int:
    """Run ``dvc repro``, trying again what failed the last time; say what failed and where the report is."""
    command = [sys.executable, "-m", "dvc", "repro"]
    if all_failures(root):
        command.append("--force")  # what is finished is kept all the same
    code = subprocess.run(command, cwd=root, check=False).returncode
    failed = show_failures(root)
    if code == 0:
        print(f"Object Files: {OBJECT_FILES.folder}/\nReport:       {REPORTS}/index.html")
    return code or failed


def show_failures(root: Path) -> int:
    """Print what failed in the last run of each stage; return 1 if anything did."""
    failures = [
        Failure(failure.object_id, f"{stage}: {failure.error}", failure.remedy)
        for stage, failure in all_failures(root)
    ]
    if failures:
        print(failure_table(failures))
    return 1 if failures else 0


def all_failures(root: Path) -> list[tuple[str, Failure]]:
    """Return the first failure of each object in the last runs, with its stage; paths from `root`."""
    first: dict[str, tuple[str, Failure]] = {}
    for stage in STAGES:
        for failure in read_failures(root, stage):
            error = failure.error.replace(f"{root}/", "")
            first.setdefault(failure.object_id, (stage, replace(failure, error=error)))
    return list(first.values())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m pipeline", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in ("starter", *STAGES, "report"):
        commands.add_parser(name, help=f"run the stage {name}")
    commands.add_parser("products", help="run all stages that make products, with no barrier between them")
    choose = commands.add_parser("select", help="choose objects in params.yaml")
    choose.add_argument("--objects", help="table of objects, a CSV file")
    choose.add_argument("--only", help="ids with commas between them; empty for all")
    commands.add_parser("dataset", help="run dvc repro, try failed objects again, say where the report is")
    commands.add_parser("failures", help="show what failed in the last runs; exit 1 if any did")
    return parser


if __name__ == "__main__":
    sys.exit(main())
