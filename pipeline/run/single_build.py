"""One Object File from one mesh, by the pipeline's own stages, without DVC."""

import contextlib
import math
import re
import shutil
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError, SimulationError
from pipeline.dataset.project_files import MATERIALS, PARAMETERS

if TYPE_CHECKING:
    from objectfolder.catalogue import ObjectRecord


@dataclass(frozen=True, kw_only=True)
class Building:
    """What is known of a mesh, and how its Object File is made.

    Parameters
    ----------
    material
        a row of the materials table
    length_m
        longest side in metres (default: as in the file)
    texture
        base colour image (default: the mesh's own)
    object_id
        identifier (default: the name of the Object File)
    name
        name in words (default: the identifier)
    source
        where the mesh is from
    licence
        licence of the mesh
    attribution
        whom to name
    materials
        materials table (CSV)
    params
        parameters (params.yaml)
    keep
        folder that keeps the ground truth; a later build resumes from it
    """

    material: str
    length_m: float | None = None
    texture: Path | None = None
    object_id: str | None = None
    name: str | None = None
    source: str = ""
    licence: str = "not stated"
    attribution: str = "not stated"
    materials: Path = MATERIALS
    params: Path = PARAMETERS
    keep: Path | None = None


def build_object_file(mesh: Path, wanted: Building, output: Path) -> dict[str, float]:
    """Build, verify and save an Object File; return the CPU seconds of each stage.

    Raises
    ------
    InputError
        A mesh, a material, a length or a name that cannot be used.
    SimulationError
        A stage that failed, with its error and remedy.
    """
    from objectfolder.audio.materials import find_material, read_materials
    from pipeline.cluster.cluster import runner
    from pipeline.cluster.places import Place
    from pipeline.dataset.parameters import read_parameters
    from pipeline.dataset.records import row_of
    from pipeline.dataset.stages import OBJECT_FILES, STAGES
    from pipeline.run.converge import converge
    from pipeline.run.costs import costs_path, read_costs

    record = _record(mesh, wanted, output)
    material = find_material(read_materials(wanted.materials), wanted.material, str(wanted.materials))
    parameters = read_parameters(wanted.params)
    rows = {record.id: row_of(record, material)}
    kept = contextlib.nullcontext(wanted.keep) if wanted.keep else None
    with kept or tempfile.TemporaryDirectory(prefix="objectfolder-") as folder:
        root = Path(folder).resolve()
        root.mkdir(parents=True, exist_ok=True)
        # One stage at a time, so that one child process serves and a failure ends the rest.
        place = Place(kwargs={"threads_per_worker": 1})
        for name, stage in STAGES.items():
            (summary,) = converge([stage], root, parameters, rows, partial(runner, place, root))
            if summary.failures:
                failure = summary.failures[0]
                raise SimulationError(f"{record.id}, stage {name}", failure.error, failure.remedy)
        output.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(OBJECT_FILES.path(root, record.id), output)
        return {
            cost.stage: cost.cpu_s
            for cost in read_costs(costs_path(root))
            if cost.object_id == record.id and cost.stage in STAGES and cost.cpu_s is not None
        }


def _record(mesh: Path, wanted: Building, output: Path) -> "ObjectRecord":
    """Return the object as a table would have it."""
    from objectfolder.catalogue import ObjectRecord

    if output.suffix != ".safetensors":
        raise InputError(str(output), "does not end in .safetensors", "Name the Object File so.")
    for path in (mesh, wanted.texture):
        if path is not None and not path.is_file():
            raise InputError(str(path), "no such file", "Check the path.")
    length_m = wanted.length_m
    if length_m is not None and not (math.isfinite(length_m) and length_m > 0):
        raise InputError("--length", f"{length_m} m", "Give the longest side in metres, above 0.")
    object_id = wanted.object_id or re.sub(r"[^A-Za-z0-9_.-]", "_", output.stem).lstrip(".") or "object"
    return ObjectRecord(
        id=object_id,
        name=wanted.name or object_id,
        mesh=mesh.resolve(),
        texture=wanted.texture.resolve() if wanted.texture else None,
        material=wanted.material,
        length_m=length_m,
        source=wanted.source,
        licence=wanted.licence,
        attribution=wanted.attribution,
        roughness=None,
        metallic=None,
    )
