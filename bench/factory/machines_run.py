"""One process of `bench.factory.machines`: a stage of one object, run by the factory's own `execute`.

Run as ``python -m bench.factory.machines_run INPUTS OUTPUTS OBJECT STAGE TIMES``. INPUTS and OUTPUTS are
roots of data sets. The last of TIMES runs counts. Prints what it cost, or why it failed, as a line of JSON.
"""

import json
import sys
from pathlib import Path

from objectfolder.products.provenance import fingerprint
from pipeline.dataset.parameters import read_parameters
from pipeline.dataset.records import read_table
from pipeline.dataset.stages import STAGES
from pipeline.dataset.task import Call
from pipeline.dataset.verified import Verified
from pipeline.sandbox.child import execute


def run(inputs: Path, outputs: Path, object_id: str, name: str) -> dict[str, object]:
    """Run one stage of one object; what it cost, or why it failed."""
    parameters = read_parameters(inputs / "params.yaml")
    row = read_table(inputs, parameters.objects).rows[object_id]
    stage = STAGES[name]
    ready = stage.prepare(inputs, parameters, object_id, row, Verified(inputs))
    targets = stage.targets(outputs, object_id)
    outcome = execute(Call(name, stage.task, ready.request, targets, fingerprint(ready.parts), ready.parts))
    failure = None if outcome.failure is None else f"{outcome.failure.error}\n{outcome.failure.detail}"
    return {"cpu_s": outcome.cpu_s, "wall_s": outcome.wall_s, "failure": failure}


def main() -> None:
    inputs, outputs = Path(sys.argv[1]), Path(sys.argv[2])
    for _ in range(int(sys.argv[5])):
        done = run(inputs, outputs, sys.argv[3], sys.argv[4])
    print(json.dumps(done), flush=True)


if __name__ == "__main__":
    main()
