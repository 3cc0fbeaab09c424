"""``python -m pipeline.cli.declare``: write into ``dvc.yaml`` what the stages of products declare.

Code counts by package, for DVC reads and writes ``dvc.lock`` anew in every stage. What else stands in
the file is kept, with its comments.
"""

import io
import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from objectfolder.products.atomic import write_whole
from pipeline.dataset.failures import FAILURES
from pipeline.dataset.records import MATERIALS, RECORDS
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES

CODE = ("objectfolder", "pipeline/dataset", "requirements.lock")
HEAD_OF_STAGE = re.compile(r"(?<=[^:\s])\n(  \w+:\n    desc:)")


def declared(stage: Stage) -> dict[str, Any]:
    """Return ``cmd``, ``deps``, ``params`` and ``outs`` of a stage."""
    deps = {*CODE, f"{stage.task.partition(':')[0].replace('.', '/')}.py"}
    outs: list[dict[str, Any]] = [{kind.folder: {"persist": True}} for kind in stage.products]
    listed = {"cache": False, "persist": True}
    if stage.sources is None:
        deps |= {str(RECORDS), *(product.kind.folder for product in stage.inputs)}
    else:
        deps |= {"${objects.table}", str(MATERIALS), "data/starter"}
        outs.append({str(RECORDS): listed})
    if stage.name == next(reversed(STAGES)):
        outs.append({str(FAILURES): listed})
    sections = {f"sizes.${{size}}.{name.partition('.')[0]}" for name in stage.parameters}
    return {
        "cmd": f"python -m pipeline.run.converged || python -m pipeline.cli stage {stage.name}",
        "deps": sorted(deps),
        "params": [
            "allow_failures",
            "objects" if stage.sources else "objects.only",
            "seed",
            *sorted(sections),
        ],
        "outs": outs,
    }


def write(path: Path = Path("dvc.yaml")) -> None:
    """Bring the file to what is declared."""
    yaml = YAML()
    yaml.width = 110
    yaml.indent(mapping=2, sequence=4, offset=2)
    content = yaml.load(path.read_text(encoding="utf-8"))
    for name, stage in STAGES.items():
        content["stages"][name].update(declared(stage))
    text = io.StringIO()
    yaml.dump(content, text)
    write_whole(path, HEAD_OF_STAGE.sub(r"\n\n\1", text.getvalue()))


if __name__ == "__main__":
    write()
