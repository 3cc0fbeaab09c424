"""``data/code.json``: a digest of the code of each stage, by which DVC tells a comment from a change.

Comments, docstrings and layout do not count (`objectfolder.products.provenance.code_identity`), and neither
do modules that a stage does not import.
"""

import json
from collections.abc import Mapping
from pathlib import Path

from objectfolder.products.atomic import write_whole
from objectfolder.products.provenance import file_digest, fingerprint, package_versions
from pipeline.dataset.parameters import PARAMETERS, read_parameters
from pipeline.dataset.stages import STAGES
from pipeline.dataset.verified import Verified

CODE = Path("data/code.json")
STARTER, REPORT, SENSOR = "starter", "report", "sensor"
MODULES = {STARTER: "pipeline.intake.starter.write", REPORT: "pipeline.publish.report.report"}
PAGES = Path(__file__).parents[1] / "publish"


def write_code_digests(root: Path) -> None:
    """Write the digests of the code that runs now, and of the sensor that ``params.yaml`` names.

    Raises
    ------
    InputError
        ``params.yaml`` cannot be used.
    """
    sensor = read_parameters(root / PARAMETERS).values_at("touch.sensor")
    states = Verified(root)
    parts: dict[str, Mapping[str, object]] = {
        name: {
            "code": states.code_identity(stage.task.partition(":")[0]),
            "packages": package_versions(stage.packages),
        }
        for name, stage in STAGES.items()
    }
    parts |= {name: {"code": states.code_identity(module)} for name, module in MODULES.items()}
    parts[REPORT] = {**parts[REPORT], "files": _other_files(PAGES)}
    parts[SENSOR] = {"sensor": sensor}
    states.save_code()
    digests = {name: fingerprint(part)[:16] for name, part in parts.items()}
    write_whole(root / CODE, json.dumps(digests, indent=1) + "\n")


def _other_files(folder: Path) -> dict[str, str]:
    """Return digests of what is no Python below a folder."""
    return {
        path.relative_to(folder).as_posix(): file_digest(path)
        for path in sorted(folder.rglob("*.*"))
        if path.is_file() and path.suffix not in (".py", ".pyc")
    }
