"""``python -m pipeline.cli.declare``: write into ``dvc.yaml`` what the stages of products declare.

What else stands in the file is kept, with its comments.
"""

import io
import re
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from objectfolder.products.atomic import write_whole
from pipeline.dataset.failures import FAILURES, RETRY
from pipeline.dataset.manifest import MANIFEST, PRODUCTS
from pipeline.dataset.records import RECORDS
from pipeline.dataset.selection import SELECTION_FOLDER
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES
from pipeline.run.code_digests import CODE, SENSOR
from pipeline.run.record import receipt_path
from pipeline.run.source_digests import INPUTS

MADE_BY_ALL = "products"
HEAD_OF_STAGE = re.compile(r"(?<=[^:\s])\n(  \w+:\n    desc:)")


def declared() -> dict[str, dict[str, Any]]:
    """Return what the stage of all products, and those that own folders, run, read and make."""
    stages = STAGES.values()
    sections = {f"sizes.${{size}}.{name.partition('.')[0]}" for stage in stages for name in stage.parameters}
    products = {
        "cmd": f"exec python -m pipeline.cli {MADE_BY_ALL}",
        "deps": [str(path) for path in (INPUTS, RECORDS, RETRY, SELECTION_FOLDER)],
        "params": [
            "allow_failures",
            "seed",
            *sorted(sections),
            {str(CODE): [*STAGES, SENSOR]},
        ],
        "outs": [
            {str(PRODUCTS): {"persist": True}},
            *({str(path): {"cache": False, "persist": True}} for path in (FAILURES, MANIFEST)),
        ],
    }
    folder_stages = {stage.name: _recorded(stage) for stage in stages}
    # After all stages, so that what is finished is recorded before the run ends with an error.
    last = [str(FAILURES), *sorted(str(receipt_path(stage.name)) for stage in stages), "reports/index.html"]
    failures = {"cmd": "exec python -m pipeline.cli failures --retry", "deps": last}
    return {MADE_BY_ALL: products, **folder_stages, "failures": failures}


def _recorded(stage: Stage) -> dict[str, Any]:
    """Return a stage that owns the folders of products, and hangs on its key of the manifest."""
    return {
        "cmd": f"exec python -m pipeline.run.record {stage.name}",
        "params": [{str(MANIFEST): [f"stages.{stage.name}"]}],
        "outs": [
            *({kind.folder: {"persist": True}} for kind in stage.products),
            str(receipt_path(stage.name)),
        ],
    }


def write(path: Path = Path("dvc.yaml")) -> None:
    """Bring the file to what is declared."""
    yaml = YAML()
    yaml.width = 110
    yaml.indent(mapping=2, sequence=4, offset=2)
    content = yaml.load(path.read_text(encoding="utf-8"))
    for name, sections in declared().items():
        content["stages"][name].update(sections)
    text = io.StringIO()
    yaml.dump(content, text)
    write_whole(path, HEAD_OF_STAGE.sub(r"\n\n\1", text.getvalue()))


if __name__ == "__main__":
    write()
