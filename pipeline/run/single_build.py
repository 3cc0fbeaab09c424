"""One Object File from one mesh, by the pipeline's own stages, without DVC."""

import contextlib
import re
import shutil
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError, SimulationError
from pipeline.dataset.described_object import DescribedObject
from pipeline.dataset.project_files import PARAMETERS

if TYPE_CHECKING:
    from objectfolder.catalogue import ObjectRecord
    from objectfolder.mesh.walls import WallFinding


@dataclass(frozen=True, kw_only=True)
class Building(DescribedObject):
    """What is known of a mesh, and how its Object File is made.

    Parameters
    ----------
    licence
        licence of the mesh
    attribution
        whom to name
    params
        parameters (params.yaml)
    size
        one of their sizes (default: the one they select)
    keep
        folder that keeps the ground truth; a later build resumes from it
    """

    licence: str = "not stated"
    attribution: str = "not stated"
    params: Path = PARAMETERS
    size: str | None = None
    keep: Path | None = None


def build_object_file(wanted: Building, output: Path) -> tuple[dict[str, float], tuple["WallFinding", ...]]:
    """Build, verify and save an Object File.

    Returns
    -------
    seconds
        CPU seconds of each stage.
    findings
        What is doubtful about the object's walls and mass.

    Raises
    ------
    InputError
        A mesh, a material, a length or a name that cannot be used.
    SimulationError
        A stage that failed, with its error and remedy.
    """
    from objectfolder.audio.materials import find_material, read_materials
    from objectfolder.mesh.walls import WallMeasures
    from objectfolder.products.store import read_attributes
    from pipeline.cluster.cluster import runner
    from pipeline.cluster.places import Place
    from pipeline.dataset.parameters import read_parameters
    from pipeline.dataset.records import row_of
    from pipeline.dataset.stages import COLLISION, OBJECT_FILES, OBJECTS, STAGES
    from pipeline.run.converge import converge
    from pipeline.run.costs import costs_path, read_costs

    record = _record(wanted, output)
    material = find_material(read_materials(wanted.materials), wanted.material, str(wanted.materials))
    parameters = read_parameters(wanted.params, wanted.size)
    rows = {record.id: row_of(record, material)}
    kept = contextlib.nullcontext(wanted.keep) if wanted.keep else None
    with kept or tempfile.TemporaryDirectory(prefix="objectfolder-") as folder:
        root = Path(folder).resolve()
        root.mkdir(parents=True, exist_ok=True)
        # One stage at a time, so that one child process serves and a failure ends the rest.
        place = Place(kwargs={"threads_per_worker": 1})
        for name, stage in STAGES.items():
            if name == COLLISION.made_by:
                continue  # no part of an Object File
            (summary,) = converge([stage], root, parameters, rows, partial(runner, place, root))
            if summary.failures:
                failure = summary.failures[0]
                raise SimulationError(f"{record.id}, stage {name}", failure.error, failure.remedy)
        output.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(OBJECT_FILES.path(root, record.id), output)
        walls = WallMeasures(**read_attributes(OBJECTS.path(root, record.id))["walls"])
        seconds = {
            cost.stage: cost.cpu_s
            for cost in read_costs(costs_path(root))
            if cost.object_id == record.id and cost.stage in STAGES and cost.cpu_s is not None
        }
        return seconds, wanted.wall_findings(walls, material)


def _record(wanted: Building, output: Path) -> "ObjectRecord":
    """Return the object as a table would have it."""
    from objectfolder.catalogue import ObjectRecord

    if output.suffix != ".safetensors":
        raise InputError(str(output), "does not end in .safetensors", "Name the Object File so.")
    wanted.check()
    object_id = wanted.object_id or re.sub(r"[^A-Za-z0-9_.-]", "_", output.stem).lstrip(".") or "object"
    return ObjectRecord(
        id=object_id,
        name=wanted.name or object_id,
        mesh=wanted.mesh.resolve(),
        texture=wanted.texture.resolve() if wanted.texture else None,
        material=wanted.material,
        length_m=wanted.length_m,
        source=wanted.source,
        licence=wanted.licence,
        attribution=wanted.attribution,
        roughness=wanted.roughness,
        metallic=wanted.metallic,
        wall_m=wanted.wall_m,
        shell_m=wanted.shell_m,
        mass_kg=wanted.mass_kg,
        senses=wanted.senses,
    )
