"""Seconds and memory beside the data: read from a table, because products hold no timings."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.dataset.stages import STAGES
from pipeline.run.costs import QUERY, Cost, read_costs


@dataclass(frozen=True)
class Costs:
    """Costs by object: of the stages, and of one query at a setting of its effort."""

    stages: Mapping[tuple[str, str], list[Cost]] = field(default_factory=dict)
    queries: Mapping[tuple[str, str], list[tuple[str, float]]] = field(default_factory=dict)

    def stage(self, object_id: str, stage: str, fingerprints: Mapping[str, str]) -> Cost | None:
        """Return the cost of the product that is in use, the latest row where that is not known.

        Parameters
        ----------
        fingerprints
            Stage to the fingerprint of the product the fidelity was measured on.
        """
        rows = self.stages.get((object_id, stage), [])
        wanted = fingerprints.get(stage)
        if wanted is not None:
            rows = [row for row in rows if row.fingerprint == wanted]
        return rows[-1] if rows else None

    def stage_names(self, object_ids: Collection[str]) -> tuple[str, ...]:
        """Return the stages in order of the pipeline, others that these objects have behind them."""
        others = {stage for object_id, stage in self.stages if object_id in object_ids} - set(STAGES)
        return tuple(STAGES) + tuple(sorted(others))

    def seconds_per_query(self, object_id: str, key: str, fingerprints: Mapping[str, str]) -> float | None:
        """Return the seconds of one query measured with the fidelity in use, None where there are none.

        Parameters
        ----------
        key
            Of a setting in the fidelity product.
        fingerprints
            As for `stage`.
        """
        wanted = fingerprints.get("fidelity")
        found = self.queries.get((object_id, key), [])
        seconds = [value for fingerprint, value in found if wanted in (None, fingerprint)]
        return seconds[-1] if seconds else None


def costs_by_object(path: Path) -> Costs:
    """Read the cost table by object; no file means that nothing was measured here.

    Raises
    ------
    InputError
        A table without the columns object and stage, or no text at all.
    """
    stages: dict[tuple[str, str], list[Cost]] = {}
    queries: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for cost in read_costs(path):
        if cost.stage != QUERY:
            stages.setdefault((cost.object_id, cost.stage), []).append(cost)
        elif cost.seconds_per_query is not None:
            timed = (cost.fingerprint, cost.seconds_per_query)
            queries.setdefault((cost.object_id, cost.key), []).append(timed)
    return Costs(stages, queries)
