"""The objects of a report: what each says of itself, what all say together, and their costs."""

import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError
from objectfolder.products.store import read_attributes
from pipeline.dataset.failures import FailedObject
from pipeline.dataset.measures import BYTES, REPORTED, Measure, number_at, smallest_margin_db
from pipeline.dataset.products import ZARR
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import without_collector
from pipeline.run.costs import QUERY, Cost

COST = Measure("cpu_seconds", "Cost, mesh to verified file", "CPU s", 0, False, 240.0)


@dataclass(frozen=True)
class MeasuredObject:
    """One object: the attributes of its fidelity product, and the costs of its tasks in the order they ran.

    Parameters
    ----------
    stored_name
        Name of its products on disk, without a suffix.
    """

    stored_name: str
    attributes: Mapping[str, Any]
    costs: Sequence[Cost] = ()

    @cached_property
    def object_id(self) -> str:
        """Name of the object in every table."""
        return str(self.description.get("id") or self.stored_name)

    @property
    def name(self) -> str:
        """Name for people."""
        return str(self.description.get("name") or self.object_id)

    @property
    def description(self) -> Mapping[str, Any]:
        """Id, name, material, licence, attribution, source and length."""
        return self.part("object")

    @cached_property
    def margin_db(self) -> float | None:
        """Smallest margin to a target, dB."""
        return smallest_margin_db(self.attributes)

    @property
    def silent(self) -> bool:
        """Whether the solver found no audible mode."""
        return self.part("audio").get("audible") is False

    @property
    def warnings(self) -> list[str]:
        """What was found odd of the mesh."""
        return [text for text in self._list("body", "warnings") if isinstance(text, str)]

    @property
    def extents_mm(self) -> list[float]:
        """Lengths of the bounding box, mm."""
        return [1e3 * length for length in self._list("body", "extents_m") if isinstance(length, int | float)]

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages in order of the pipeline, then others that the object has behind it."""
        return stage_names([self])

    @property
    def cpu_seconds(self) -> float | None:
        """CPU seconds of all stages, None unless each was measured."""
        costs = [self.cost(stage) for stage in self.stages]
        seconds = [cost.cpu_s for cost in costs if cost and cost.cpu_s is not None]
        return sum(seconds) if len(seconds) == len(costs) else None

    @property
    def efforts(self) -> list[dict[str, Any]]:
        """Bytes, seconds and error at each setting of each sense, in the order of the product."""
        fingerprints = self.attributes.get("speed_error")
        return [
            {
                "object": self.object_id,
                "sense": str(entry.get("sense") or ""),
                "setting": str(entry.get("setting") or ""),
                "value": number_at(entry, "value"),
                "seconds_per_query": self._seconds_per_query(str(entry.get("key") or "")),
                "bytes": number_at(entry, "bytes"),
                "error": number_at(entry, "error"),
                "error_unit": str(entry.get("error_unit") or ""),
            }
            for entry in (fingerprints if isinstance(fingerprints, list) else [])
            if isinstance(entry, Mapping)
        ]

    def part(self, name: str) -> Mapping[str, Any]:
        """Return a part of the attributes, empty where the product has none."""
        part = self.attributes.get(name)
        return part if isinstance(part, dict | Mapping) else {}

    def cost(self, stage: str) -> Cost | None:
        """Return the cost of the product that was measured, the latest where that is not known."""
        return self._cost_by_stage.get(stage)

    @cached_property
    def _cost_by_stage(self) -> dict[str, Cost | None]:
        rows: dict[str, list[Cost]] = {}
        for cost in self.costs:
            rows.setdefault(cost.stage, []).append(cost)
        return {stage: self._latest(costs, stage) for stage, costs in rows.items()}

    def _seconds_per_query(self, key: str) -> float | None:
        rows = [cost for cost in self.costs if cost.stage == QUERY and cost.key == key]
        latest = self._latest([cost for cost in rows if cost.seconds_per_query is not None], "fidelity")
        return latest.seconds_per_query if latest else None

    def _latest(self, rows: Sequence[Cost], stage: str) -> Cost | None:
        fingerprints = self.part("provenance").get("fingerprints")
        fingerprint = fingerprints.get(stage) if isinstance(fingerprints, Mapping) else None
        rows = [cost for cost in rows if fingerprint in (None, cost.fingerprint)]
        return rows[-1] if rows else None

    def _list(self, part: str, name: str) -> list[Any]:
        value = self.part(part).get(name)
        return value if isinstance(value, list) else []


@without_collector()
def read_objects(folder: Path, costs: Iterable[Cost]) -> tuple[list[MeasuredObject], list[FailedObject]]:
    """Read the attributes of every fidelity product of `folder`.

    Returns
    -------
    tuple
        The objects by id, and a failure for each product that cannot be read.
    """
    own: dict[str, list[Cost]] = {}
    for cost in costs:
        own.setdefault(cost.object_id, []).append(cost)
    objects, failures = [], []
    for path in sorted(folder.glob(f"*{ZARR}")):
        name = path.name.removesuffix(ZARR)
        try:
            subject = MeasuredObject(name, read_attributes(path))
            objects.append(replace(subject, costs=own.get(subject.object_id, ())))
        except FormatError as error:
            failures.append(FailedObject(name, "report", f"{path.name}: {error.finding}", error.remedy))
    return sorted(objects, key=lambda subject: subject.object_id), failures


def stage_names(objects: Iterable[MeasuredObject]) -> tuple[str, ...]:
    """Return the stages in order of the pipeline, then others that these objects have behind them."""
    more = {cost.stage for subject in objects for cost in subject.costs} - {*STAGES, QUERY}
    return (*STAGES, *sorted(more))


def worst_first(objects: Sequence[MeasuredObject]) -> list[MeasuredObject]:
    """Order by the smallest margin to a target, worst first; objects without a measure come last."""
    return sorted(
        objects, key=lambda subject: (subject.margin_db is None, subject.margin_db or 0.0, subject.object_id)
    )


@dataclass(frozen=True)
class MeasureSummary:
    """A measure over the objects that have it; all numbers are None where none has.

    Parameters
    ----------
    values
        Value and id of each object.
    trivial
        Mean score of the trivial answer.
    noise_floor
        Mean of the best scores that the noise of the truth allows.
    """

    measure: Measure
    values: Sequence[tuple[float, str]]
    trivial: float | None = None
    noise_floor: float | None = None

    @property
    def mean(self) -> float | None:
        """Mean over the objects."""
        return mean([value for value, _ in self.values])

    @property
    def median(self) -> float | None:
        """Median over the objects."""
        return statistics.median([value for value, _ in self.values]) if self.values else None

    @property
    def worst(self) -> float | None:
        """Worst of the objects."""
        return self.measure.worst([value for value, _ in self.values]) if self.values else None

    @property
    def worst_object(self) -> str:
        """Id of the worst object, empty for none."""
        worst = self.worst
        return next((object_id for value, object_id in self.values if value == worst), "")

    @property
    def met(self) -> bool | None:
        """Whether the mean reaches the target; None where there is no target or no mean."""
        if self.mean is None or self.measure.target is None:
            return None
        return self.measure.margin(self.mean) >= 0


def summaries(objects: Sequence[MeasuredObject]) -> list[MeasureSummary]:
    """Return every headline measure and the bytes; silent objects leave those of audio.

    An occasional measure that no object has is left out.
    """
    results = []
    for measure in (*REPORTED, BYTES):
        subjects = [subject for subject in objects if not (measure.sense == "audio" and subject.silent)]
        present = [
            (value, subject) for subject in subjects if (value := measure.of(subject.attributes)) is not None
        ]
        if measure.occasional and not present:
            continue
        trivial = mean([measure.trivial_of(subject.attributes) for _, subject in present])
        floor = mean([measure.noise_floor_of(subject.attributes) for _, subject in present])
        values = [(value, subject.object_id) for value, subject in present]
        results.append(MeasureSummary(measure, values, trivial, floor))
    return results


def cost_summary(objects: Sequence[MeasuredObject]) -> MeasureSummary:
    """Return the cost of the objects whose every stage was measured."""
    seconds = [(subject.cpu_seconds, subject.object_id) for subject in objects]
    return MeasureSummary(COST, [(value, object_id) for value, object_id in seconds if value is not None])


def mean(values: Sequence[float | None]) -> float | None:
    """Return the mean of the values that are there, None where none is."""
    present = [value for value in values if value is not None]
    return statistics.fmean(present) if present else None
