"""The reports of all partitions of a long table in a page: ``partitions/index.html`` and ``metrics.json``."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from objectfolder.products.atomic import write_whole
from pipeline.dataset.failures import read_failures
from pipeline.dataset.manifest import read_summary
from pipeline.dataset.measures import BYTES, HEADLINE, REPORTED, Measure
from pipeline.dataset.partition_folders import FOLDER, folders
from pipeline.publish.report.summary import metrics_text
from pipeline.publish.report.templates import security_policy, template_environment
from pipeline.run.partitions import PER_OBJECT


@dataclass(frozen=True)
class Tally:
    """A measure over objects: how many have it, the sum of its values, and the worst of them."""

    measure: Measure
    count: int
    total: float
    worst: float | None

    @classmethod
    def of(cls, measure: Measure, values: list[float]) -> "Tally":
        """Return the tally of values."""
        return cls(measure, len(values), math.fsum(values), measure.worst(values) if values else None)

    @classmethod
    def merge(cls, tallies: Sequence["Tally"]) -> "Tally":
        """Return the tally over the objects of several tallies of one measure."""
        extremes = [tally.worst for tally in tallies if tally.worst is not None]
        worst = cls.of(tallies[0].measure, extremes).worst
        count, total = sum(tally.count for tally in tallies), math.fsum(tally.total for tally in tallies)
        return cls(tallies[0].measure, count, total, worst)

    @property
    def mean(self) -> float | None:
        """Mean over the objects that have the measure; None where none has."""
        return self.total / self.count if self.count else None


@dataclass(frozen=True)
class PartitionReport:
    """What a partition's report, list of failures and manifest say of it."""

    name: str
    objects: int
    silent: int
    failed: int
    products: int
    bytes: int
    tallies: Sequence[Tally]


def write_partition_index(root: Path) -> None:
    """Write ``partitions/metrics.json``, as of one report, and the page that leads to each report.

    Only a partition's rows are in memory at a time.

    Raises
    ------
    FileNotFoundError
        A partition has no report yet.
    """
    reports = [_read(folder) for folder in folders(root)]
    tallies = [Tally.merge(same) for same in zip(*(report.tallies for report in reports), strict=True)]
    tallies_there = [tally for tally in tallies if tally.count or not tally.measure.occasional]
    objects, failed, silent = (
        sum(getattr(report, name) for report in reports) for name in ("objects", "failed", "silent")
    )
    figures = [(tally.measure, tally.mean, tally.worst) for tally in tallies_there]
    write_whole(root / FOLDER / "metrics.json", metrics_text(figures, objects, failed, silent))
    environment = template_environment()
    page = environment.get_template("partitions.html.j2").render(
        policy=security_policy(environment, ()),
        reports=reports,
        objects=objects,
        failed=failed,
        bytes=sum(report.bytes for report in reports),
        headlines=[tally for tally in tallies if tally.measure in HEADLINE],
        headline=HEADLINE,
        columns=[(measure.column, f"{measure.column_unit}, mean") for measure in HEADLINE],
    )
    write_whole(root / FOLDER / "index.html", page)


def _read(folder: Path) -> PartitionReport:
    with (folder / PER_OBJECT).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    silent = [row for row in rows if row["audio.audible"] == "0"]
    audible = [row for row in rows if row["audio.audible"] != "0"]

    def values(measure: Measure) -> list[float]:
        subjects = audible if measure.sense == "audio" else rows
        return [float(text) for row in subjects if (text := row.get(measure.key))]

    stages = read_summary(folder).values()
    return PartitionReport(
        name=folder.name,
        objects=len(rows),
        silent=len(silent),
        failed=len({failure.object for failure in read_failures(folder)}),
        products=sum(int(stage["products"]) for stage in stages),
        bytes=sum(int(stage["bytes"]) for stage in stages),
        tallies=[Tally.of(measure, values(measure)) for measure in (*REPORTED, BYTES)],
    )
