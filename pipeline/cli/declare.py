"""``python -m pipeline.cli.declare``: write into ``dvc.yaml`` what the stages themselves declare.

Dependencies, parameters and outputs of the stages that make products, and the code that the other stages
run. What else stands in the file is kept.
"""

import io
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from objectfolder.products.atomic import atomic_write
from objectfolder.products.provenance import code_identity
from pipeline.dataset.failures import FAILURES
from pipeline.dataset.records import MATERIALS, RECORDS
from pipeline.dataset.stage import Stage
from pipeline.dataset.stages import STAGES

DVC_YAML = Path("dvc.yaml")
# What decides a fingerprint besides the parts that it is made from.
FINGERPRINTS = "objectfolder/products/provenance.py"
LOCK = "requirements.lock"
TABLE = "${objects.table}"
STARTER = "data/starter"
STARTER_CODE = "objectfolder.mesh.starter"
STAGE_HEAD = re.compile(r"(?<=[^:\s])\n(  \w+:\n    desc:)")
# Packages on which a stage depends as a whole, if on any of their modules.
WHOLE = (
    "objectfolder.audio", "objectfolder.fidelity", "objectfolder.mesh", "objectfolder.solid",
    "objectfolder.surface", "objectfolder.touch", "objectfolder.vision",
    "pipeline.audit", "pipeline.dataset", "pipeline.intake", "pipeline.publish",
)  # fmt: skip


def declared() -> dict[str, dict[str, Any]]:
    """Return ``cmd``, ``deps``, ``params`` and ``outs`` by stage, as far as code declares them."""
    found = {name: _product_stage(stage) for name, stage in STAGES.items()}
    found[next(reversed(STAGES))]["outs"].append({str(FAILURES): {"cache": False, "persist": True}})
    products = [kind.folder for stage in STAGES.values() for kind in stage.products]
    report = {
        *code_files("pipeline.publish.data_set"),
        *products,
        str(RECORDS),
        str(FAILURES),
    }
    return {
        **found,
        "starter": {"deps": sorted(code_files(f"{STARTER_CODE}.write", (STARTER_CODE,)))},
        "report": {"deps": sorted(report)},
    }


def write(path: Path = DVC_YAML) -> None:
    """Bring ``dvc.yaml`` to what is declared, its comments kept."""
    yaml = YAML()
    yaml.width = 110
    yaml.indent(mapping=2, sequence=4, offset=2)
    content = yaml.load(path.read_text(encoding="utf-8"))
    for name, sections in declared().items():
        content["stages"][name].update(sections)
    text = io.StringIO()
    yaml.dump(content, text)
    with atomic_write(path) as file:
        file.write(STAGE_HEAD.sub(r"\n\n\1", text.getvalue()).encode())


def _product_stage(stage: Stage) -> dict[str, Any]:
    deps = {"pipeline/dataset", FINGERPRINTS, LOCK, *code_files(stage.task.partition(":")[0])}
    outs: list[dict[str, Any]] = [{kind.folder: {"persist": True}} for kind in stage.products]
    if stage.sources is None:
        deps |= {str(RECORDS), *(product.kind.folder for product in stage.inputs)}
        selection = "objects.only"
    else:
        # The first stage reads the table itself, by the modules that `pipeline.dataset` names.
        deps |= {TABLE, str(MATERIALS), STARTER, *code_files("pipeline.dataset.stages")}
        outs.append({str(RECORDS): {"cache": False, "persist": True}})
        selection = "objects"
    sections = {f"sizes.${{size}}.{name.partition('.')[0]}" for name in stage.parameters}
    return {
        "cmd": f"python -m pipeline.run.converged || python -m pipeline.cli stage {stage.name}",
        "deps": sorted(deps),
        "params": ["allow_failures", selection, "seed", *sorted(sections)],
        "outs": outs,
    }


def code_files(module: str, whole: Sequence[str] = WHOLE) -> set[str]:
    """Return where the code of a module and of its imports is: files, and folders of packages in `whole`."""
    found = set()
    for name in code_identity(module):
        package = next((package for package in whole if name.startswith(f"{package}.")), None)
        path = Path(*(package or name).split("."))
        found.add(path.as_posix() if package else _source(path))
    return found


def _source(path: Path) -> str:
    return (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).as_posix()


if __name__ == "__main__":
    write()
