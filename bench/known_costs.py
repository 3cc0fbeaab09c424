"""Write what every object and stage of data sets cost into the package, where estimates start from it.

    python -m bench.known_costs ROOT [ROOT ...]

Each ROOT is a data set made at the default size. Wall seconds are those of the run, so a busy machine shows
in them; CPU seconds show it less.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stages import STAGES
from pipeline.run.forecast.known_costs import PACKAGED, costs_of, product_bytes, write_costs
from pipeline.run.forecast.loads import Loads


def main() -> None:
    parser = argparse.ArgumentParser(description="costs of data sets, for the package")
    parser.add_argument("roots", type=Path, nargs="+", help="data sets")
    costs = {}
    for root in parser.parse_args().roots:
        listed = read_table(root, read_parameters(root / "params.yaml").objects).rows
        loads = Loads(root)
        for cost in costs_of(root):
            if cost.object_id not in listed or cost.stage not in STAGES:
                continue
            sources = STAGES[cost.stage].sources
            size = (
                next(path.stat().st_size for path in sources(listed[cost.object_id]).values())
                if sources
                else None
            )
            load = loads.of(cost.stage, cost.object_id, size)
            made = product_bytes(root, STAGES[cost.stage], cost.object_id)
            costs[cost.object_id, cost.stage] = replace(cost, load=load, product_bytes=made)
    order = list(STAGES)
    rows = sorted(costs.values(), key=lambda cost: (order.index(cost.stage), cost.object_id))
    write_costs(rows, PACKAGED)
    print(f"{len(rows)} rows in {PACKAGED.name}")


if __name__ == "__main__":
    main()
