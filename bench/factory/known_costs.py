"""Write what every object and stage of data sets cost into the package, where estimates start from it.

    python -m bench.factory.known_costs ROOT [ROOT ...]

Each ROOT is a data set made at the default size. Wall seconds are those of the run, so a busy machine shows
in them; CPU seconds show it less.
"""

import csv
from pathlib import Path

from bench.record import arguments
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stages import STAGES
from pipeline.run.costs import known_costs
from pipeline.run.forecast.estimates import PACKAGED, Estimates, last_costs

COLUMNS = ("object", "stage", "load", "cpu_seconds", "wall_seconds", "peak_memory_mb", "product_bytes")


def main() -> None:
    parser = arguments("costs of data sets, for the package")
    parser.add_argument("roots", type=Path, nargs="+", help="data sets")
    rows = {}
    for root in parser.parse_args().roots:
        listed = read_table(root, read_parameters(root / "params.yaml").objects).rows
        estimates = Estimates(root)
        for (object_id, stage), one in last_costs(known_costs(root)).items():
            if object_id in listed and stage in STAGES:
                load = estimates.load(stage, object_id)
                targets = STAGES[stage].targets(root, object_id)
                rows[stage, object_id] = {
                    "object": object_id,
                    "stage": stage,
                    "load": "" if load is None else f"{load:.6g}",
                    "cpu_seconds": round(one.cpu_s, 2),
                    "wall_seconds": round(one.wall_s, 2),
                    "peak_memory_mb": round(one.memory_bytes / 1e6, 1),
                    "product_bytes": sum(path.stat().st_size for path in targets),
                }
    order = list(STAGES)
    with PACKAGED.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[key] for key in sorted(rows, key=lambda key: (order.index(key[0]), key[1])))
    print(f"{len(rows)} rows in {PACKAGED.name}")


if __name__ == "__main__":
    main()
