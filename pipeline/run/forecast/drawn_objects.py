"""Objects that do not exist yet, drawn from those that are known: their tasks with what those took."""

import random
from collections.abc import Iterable, Mapping, Sequence

from pipeline.run.forecast.known_costs import KnownCost

Costs = Mapping[str, KnownCost]  # by stage


def known_objects(costs: Iterable[KnownCost], stages: Sequence[str], seed: int) -> dict[str, Costs]:
    """Return the known objects with a cost for each stage.

    A stage in which an object was never run gets the cost of an object drawn from those that were.

    Raises
    ------
    ValueError
        A stage in which no object was run.
    """
    by_stage: dict[str, dict[str, KnownCost]] = {stage: {} for stage in stages}
    for cost in costs:
        if cost.stage in by_stage:
            by_stage[cost.stage][cost.object_id] = cost
    for stage, rows in by_stage.items():
        if not rows:
            raise ValueError(f"no known costs of stage {stage}")
    rng = random.Random(seed)
    names = sorted({name for rows in by_stage.values() for name in rows})
    return {
        name: {
            stage: rows[name] if name in rows else rng.choice([rows[other] for other in sorted(rows)])
            for stage, rows in by_stage.items()
        }
        for name in names
    }


def drawn_objects(known: Mapping[str, Costs], count: int, seed: int) -> dict[str, Costs]:
    """Return `count` objects, each with all the costs of a known one drawn with replacement."""
    rng = random.Random(seed)
    names = sorted(known)
    return {f"drawn{index:08d}": known[rng.choice(names)] for index in range(count)}
