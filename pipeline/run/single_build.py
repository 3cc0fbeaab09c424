"""One Object File from one mesh, by the pipeline's own stages, without DVC."""

import contextlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from objectfolder.errors import InputError, SimulationError
from pipeline.dataset.described_object import DescribedObject
from pipeline.dataset.project_files import PARAMETERS

if TYPE_CHECKING:
    from objectfolder.making.materials import Material
    from pipeline.dataset.catalogue import ObjectRecord
    from pipeline.dataset.job import Finished, Job, Runner


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
        folder that keeps the ground truth; a later build resumes from it (default: the user's cache folder,
        until the build succeeds)
    """

    licence: str = "not stated"
    attribution: str = "not stated"
    params: Path = PARAMETERS
    size: str | None = None
    keep: Path | None = None


class Built(NamedTuple):
    """What a build took, and what its mesh is.

    Parameters
    ----------
    cpu_s
        CPU seconds of each stage.
    looks
        Textures, colours and maps in a line.
    warnings
        What was read otherwise than the file says it, and what is doubtful about surface, walls and mass.
    """

    cpu_s: dict[str, float]
    looks: str
    warnings: tuple[str, ...]


def build_object_file(
    building: Building, output: Path, confirm: Callable[[Building, "Material"], None] | None = None
) -> Built:
    """Build, verify and save an Object File.

    A build that is interrupted, or fails, leaves the stages that it finished; the next build from the same
    mesh to the same `output` resumes from them, and one that succeeds removes them.

    Parameters
    ----------
    building
        The mesh, what is known of it, and how to build.
    output
        The Object File; one that is there already is replaced.
    confirm
        Called before anything is made; what it raises ends the build.

    Returns
    -------
    Built

    Raises
    ------
    InputError
        A mesh, a material, a length or a name that cannot be used.
    SimulationError
        A stage that failed, with its error and remedy.
    """
    from objectfolder.making.mesh.readers.face_count import refuse_many_faces

    if building.decimate is None:
        refuse_many_faces(building.mesh)  # before workers start
    from objectfolder.making.materials import find_material, read_materials
    from objectfolder.products.store import read_product
    from objectfolder.surface.textured_mesh import textured_mesh_of
    from pipeline.dataset.parameters import read_parameters
    from pipeline.dataset.records import row_of
    from pipeline.dataset.stages import OBJECT_FILES, OBJECTS, STAGES
    from pipeline.run.build_cache import unfinished_build
    from pipeline.run.converge import converge
    from pipeline.run.costs import costs_path, read_costs
    from pipeline.run.decimated_mesh import with_decimated_mesh
    from pipeline.run.looks import looks_of

    record = _record(building, output)
    material = find_material(read_materials(building.materials), building.material, str(building.materials))
    parameters = read_parameters(building.params, building.size)
    folder = (
        contextlib.nullcontext(building.keep.resolve())
        if building.keep
        else unfinished_build(building.mesh, output)
    )
    with folder as root:
        root.mkdir(parents=True, exist_ok=True)
        notes: tuple[str, ...] = ()
        if building.decimate is not None:
            building, notes = with_decimated_mesh(building, material, root / "decimated")
            record = _record(building, output)
        if confirm is not None:
            confirm(building, material)
        rows = {record.id: row_of(record, material)}
        for summary in converge(list(STAGES.values()), root, parameters, rows, partial(_runner, root)):
            for failure in summary.failures:
                raise SimulationError(f"{record.id}, stage {summary.stage}", failure.error, failure.remedy)
        output.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(OBJECT_FILES.path(root, record.id), output)
        product = read_product(OBJECTS.path(root, record.id))
        seconds = {
            cost.stage: cost.cpu_s
            for cost in read_costs(costs_path(root))
            if cost.object_id == record.id and cost.stage in STAGES and cost.cpu_s is not None
        }
        warnings, findings = building.findings(product.attributes, material)
        return Built(seconds, looks_of(textured_mesh_of(product)), (*notes, *warnings, *map(str, findings)))


@contextlib.contextmanager
def _runner(root: Path, jobs_at_most: int) -> Iterator["Runner"]:
    """Yield what runs all stages in one child process, up to the first failure."""
    from pipeline.cluster.cluster import runner
    from pipeline.cluster.places import Place

    with runner(Place(kwargs={"threads_per_worker": 1}), root, 1) as running:
        yield UntilFailure(running)


class UntilFailure:
    """Runs jobs as another runner does, and ends with the first that fails."""

    def __init__(self, runner: "Runner") -> None:
        self._runner = runner

    def submit(self, job: "Job") -> None:
        """Accept a job."""
        self._runner.submit(job)

    def finished(self, on_workers: Callable[[int, int], None]) -> Iterator["Finished"]:
        """Yield jobs as they end, until one fails or none is left."""
        for end in self._runner.finished(on_workers):
            yield end
            if end.outcome.failure is not None:
                return


def _record(building: Building, output: Path) -> "ObjectRecord":
    """Return the object as a table would have it."""
    from pipeline.dataset.catalogue import ObjectRecord

    if output.suffix != ".safetensors":
        raise InputError(str(output), "does not end in .safetensors", "Name the Object File so.")
    folder = next(parent for parent in output.absolute().parents if parent.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK):  # said now, and not after minutes
        raise InputError(str(output), f"cannot be written in {folder}", "Name another folder.")
    building.check()
    object_id = building.object_id or re.sub(r"[^A-Za-z0-9_.-]", "_", output.stem).lstrip(".") or "object"
    return ObjectRecord(
        id=object_id,
        name=building.name or object_id,
        mesh=building.mesh.resolve(),
        texture=building.texture.resolve() if building.texture else None,
        material=building.material,
        length_m=building.length_m,
        up=building.up,
        source=building.source,
        licence=building.licence,
        attribution=building.attribution,
        roughness=building.roughness,
        metallic=building.metallic,
        glass=building.glass,
        wall_m=building.wall_m,
        shell_m=building.shell_m,
        mass_kg=building.mass_kg,
        senses=building.senses,
    )
