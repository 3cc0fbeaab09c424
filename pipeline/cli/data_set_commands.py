"""Commands for a whole data set: what ``dvc.yaml`` runs, select, failures, status, plan, clean."""

import json as json_text
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter
from cyclopts.validators import MutuallyExclusive, Number

from pipeline.cli.options import AtLeastOne, Cluster, Json, Root
from pipeline.cli.printing import FAILED, FINE, RESUMED, on_interrupt, print_result, print_text, status_line
from pipeline.cli.usage import UsageError

if TYPE_CHECKING:
    from pipeline.run.stage_run import StageRun

Counts = Parameter(consume_multiple=True, validator=Number(gte=1))
remove_or_list = Group(show=False, validator=MutuallyExclusive())


def stage(name: str, /, *, root: Root = Path("."), cluster: Cluster = None, json: Json = False) -> int:
    """Run one stage of dvc.yaml over all objects; current products are kept.

    Parameters
    ----------
    name
        the stage
    """
    from pipeline.run.stage_run import make_stage

    with on_interrupt(RESUMED):
        return _report_run(make_stage(root.absolute(), _stage_name(name), cluster), json=json)


def _stage_name(name: str) -> str:
    """Return the name of a stage that makes products.

    Raises
    ------
    UsageError
        There is no such stage.
    """
    from pipeline.dataset.stages import STAGES
    from pipeline.dataset.validation import did_you_mean

    if name not in STAGES:
        remedy = did_you_mean(name, STAGES, f"Stages are {', '.join(STAGES)}.")
        raise UsageError(name, "no such stage", remedy)
    return name


def _report_run(run: "StageRun", *, json: bool) -> int:
    """Print what a run did; return its exit status."""
    if json:
        print(json_text.dumps(asdict(run), indent=1))
    elif run.notes:
        print_text("\n".join(run.notes))
    return run.exit_code


def products(*, root: Root = Path("."), cluster: Cluster = None, json: Json = False) -> int:
    """Run all stages that make products, with no barrier between them."""
    from pipeline.run.stage_run import make_products

    with on_interrupt(RESUMED):
        return _report_run(make_products(root.absolute(), cluster), json=json)


def code(*, root: Root = Path(".")) -> None:
    """Write digests of the code of each stage, which comments do not change: data/code.json."""
    from pipeline.run.code_digests import write_code_digests

    write_code_digests(root.absolute())


def inputs(*, partitions: bool = False, root: Root = Path(".")) -> None:
    """Write the table and digests of the meshes: data/records.json, data/inputs.json.

    Parameters
    ----------
    partitions
        those of each partition, and its table
    """
    if partitions:
        from pipeline.run.partitions import write_partition_inputs as write
    else:
        from pipeline.run.source_digests import write_inputs as write

    write(root.absolute())


def partition(
    *, objects: Annotated[int, AtLeastOne] = 10_000, json: Json = False, root: Root = Path(".")
) -> None:
    """Cut a long table into partitions, each a data set of its own below partitions/.

    Parameters
    ----------
    objects
        a partition, at most, about
    """
    from pipeline.run.partitions import partition as lay_out

    print_result(lay_out(root.absolute(), objects), json=json)


def record(name: str, /, *, root: Root = Path("."), cluster: Cluster = None, json: Json = False) -> int:
    """Find the products of a stage as the manifest lists them; run all stages where they are not.

    Parameters
    ----------
    name
        the stage
    """
    from pipeline.run.stage_run import record_stage

    with on_interrupt(RESUMED):
        return _report_run(record_stage(root.absolute(), _stage_name(name), cluster), json=json)


def starter(*, root: Root = Path(".")) -> None:
    """Write the meshes and textures of the starter set."""
    from pipeline.intake.starter.write import write_starter_set
    from pipeline.run.exclusive import exclusive

    with exclusive(root.absolute(), "stage starter"), status_line("writing the starter set"):
        write_starter_set(root.absolute() / "data" / "starter")


def report(
    *, summary: bool = False, partitions: bool = False, json: Json = False, root: Root = Path(".")
) -> None:
    """Write the tables, the pages and the cards of the data set.

    Parameters
    ----------
    summary
        write nothing; say what the last report found, and how to look at it
    partitions
        write a page and metrics of all partitions, from their reports
    json
        print the summary as JSON
    """
    if json and not summary:
        raise UsageError("report --json", "prints a summary", "Give --summary too.")
    if partitions:
        from pipeline.publish.report.partition_index import write_partition_index

        write_partition_index(root.absolute())
    elif summary:
        from pipeline.publish.data_set import summary_of

        print_result(summary_of(root), json=json)
    else:
        with status_line("writing the report"):
            from pipeline.publish.report.report import make_report

            make_report(root.absolute())


def failures(*, retry: bool = False, json: Json = False, root: Root = Path(".")) -> int:
    """Show which objects failed; the exit status is 1 if any did.

    Parameters
    ----------
    retry
        let the next `dvc repro` try them again, as the stage of dvc.yaml does
    """
    from pipeline.dataset.failures import ask_for_retry, failure_table, read_failures

    failed_objects = read_failures(root)
    if failed_objects and retry:
        ask_for_retry(root, failed_objects)
    if json:
        print(json_text.dumps([asdict(entry) for entry in failed_objects], indent=1))
    elif failed_objects:
        print_text(f"{failure_table(failed_objects)}\n`dvc repro` tries them again.")
    return FAILED if failed_objects else FINE


def select(*, table: str | None = None, only: str | None = None, root: Root = Path(".")) -> None:
    """Choose the table of objects, and which of them this checkout makes; say what changed.

    Parameters
    ----------
    table
        table of objects, a CSV file
    only
        ids with commas between them; empty for all
    """
    from pipeline.dataset.selection import select as select_objects

    for line in select_objects(root, table, only):
        print_text(line)


def status(*, json: Json = False, root: Root = Path(".")) -> int:
    """Say which products are as the inputs ask for, which are not, and why.

    The exit status is 1 where a run has something to do.
    """
    from objectfolder.products.provenance import json_lines
    from pipeline.dataset.verified import without_collector
    from pipeline.run.exclusive import owner
    from pipeline.run.status import CURRENT, table
    from pipeline.run.status import status as states

    with without_collector():
        entries = states(root.absolute())
    if json:
        print(json_lines([entry.as_mapping() for entry in entries], 1))
    else:
        running = owner(root.absolute())
        print_text(f"in use by {running}\n\n{table(entries)}" if running else table(entries))
    return FINE if all(entry.state == CURRENT for entry in entries) else FAILED


def plan(
    *,
    table: Path | None = None,
    workers: Annotated[tuple[int, ...], Counts] = (),
    count: Annotated[int | None, AtLeastOne] = None,
    json: Json = False,
    root: Root = Path("."),
) -> None:
    """Say what a run would do and take.

    Parameters
    ----------
    table
        table of objects, a CSV file (default: that of params.yaml)
    workers
        also with these numbers of workers
    count
        for this number of objects that do not exist yet
    """
    from pipeline.run.plan import plan_data_set

    data_set_plan = plan_data_set(root.absolute(), table, workers, count)
    print_result(data_set_plan, json=json)


def clean(
    *,
    yes: Annotated[bool, Parameter(group=remove_or_list)] = False,
    dry_run: Annotated[bool, Parameter(group=remove_or_list)] = False,
    json: Json = False,
    root: Root = Path("."),
) -> None:
    """List what is safe to remove, and remove it with --yes.

    Parameters
    ----------
    yes
        remove what is listed
    dry_run
        only list it (the default)
    """
    from pipeline.run.clean import clean_data_set

    with status_line(f"looking through {root}"):
        summary = clean_data_set(root.absolute(), remove=yes)
    print_result(summary, json=json)
