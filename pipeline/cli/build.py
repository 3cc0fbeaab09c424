"""The command `build`: one Object File from one mesh, by the pipeline's own stages, without DVC."""

import argparse
import contextlib
import math
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import objectfolder
from objectfolder.errors import InputError, SimulationError
from pipeline.cli.query import fidelity_lines

REPOSITORY = Path(__file__).parents[2]


def add_commands(commands: Any) -> None:
    """Add the commands of this module to a parser's sub-commands."""
    text = "make one verified Object File from a mesh, a material and a size"
    command = commands.add_parser("build", help=text, description=text)
    command.add_argument("mesh", help="OBJ, glTF, GLB, PLY or STL")
    command.add_argument("--material", required=True, help="a row of the materials table")
    command.add_argument("--length", type=float, help="longest side in metres (default: as in the file)")
    command.add_argument("--texture", help="base colour image (default: the mesh's own)")
    command.add_argument("--id", help="identifier (default: the name of OUTPUT)")
    command.add_argument("--name", help="name in words (default: the identifier)")
    command.add_argument("--source", default="", help="where the mesh is from")
    command.add_argument("--licence", default="not stated", help="licence of the mesh")
    command.add_argument("--attribution", default="not stated", help="whom to name")
    command.add_argument(
        "--materials", default=str(REPOSITORY / "data" / "materials.csv"), help="materials table (CSV)"
    )
    command.add_argument("--params", default=str(REPOSITORY / "params.yaml"), help="parameters (params.yaml)")
    command.add_argument("--keep", metavar="FOLDER", help="keep the ground truth here, and resume from it")
    command.add_argument("-o", "--output", required=True, metavar="FILE.safetensors", help="the Object File")
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Build, verify, save; print the fidelity and the cost of each step."""
    from objectfolder.audio.materials import find_material, read_materials
    from objectfolder.catalogue import ObjectRecord
    from pipeline.cluster.cluster import runner
    from pipeline.cluster.places import Place
    from pipeline.dataset.parameters import read_parameters
    from pipeline.dataset.records import row_of
    from pipeline.dataset.stages import OBJECT_FILES, STAGES
    from pipeline.run.converge import converge
    from pipeline.run.costs import costs_path, read_costs

    output = Path(options.output)
    if output.suffix != ".safetensors":
        raise InputError(str(output), "does not end in .safetensors", "Name the Object File so.")
    object_id = options.id or re.sub(r"[^A-Za-z0-9_.-]", "_", output.stem).lstrip(".") or "object"
    for path in filter(None, (options.mesh, options.texture)):
        if not Path(path).is_file():
            raise InputError(path, "no such file", "Check the path.")
    if options.length is not None and not (math.isfinite(options.length) and options.length > 0):
        raise InputError("--length", f"{options.length} m", "Give the longest side in metres, above 0.")
    material = find_material(read_materials(Path(options.materials)), options.material, options.materials)
    parameters = read_parameters(Path(options.params))
    record = ObjectRecord(
        id=object_id,
        name=options.name or object_id,
        mesh=Path(options.mesh).resolve(),
        texture=Path(options.texture).resolve() if options.texture else None,
        material=material.name,
        length_m=options.length,
        source=options.source,
        licence=options.licence,
        attribution=options.attribution,
        roughness=None,
        metallic=None,
    )
    rows = {object_id: row_of(record, material)}
    with _workspace(options.keep) as root:
        # One stage at a time, so that one child process serves and a failure ends the rest.
        for stage in STAGES.values():
            (summary,) = converge(
                [stage], root, parameters, rows, lambda jobs: runner(Place(workers=1), root, jobs)
            )
            if summary.failures:
                failure = summary.failures[0]
                raise SimulationError(f"{object_id}, stage {stage.name}", failure.error, failure.remedy)
        output.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(OBJECT_FILES.path(root, object_id), output)
        seconds = {
            cost.stage: cost.cpu_s
            for cost in read_costs(costs_path(root))
            if cost.object_id == object_id and cost.stage in STAGES and cost.cpu_s is not None
        }
    print(f"{output}: {output.stat().st_size / 1e6:.2f} MB")
    for line in fidelity_lines(objectfolder.load(output)):
        print(line)
    steps = ", ".join(f"{name} {value:.1f}" for name, value in seconds.items())
    print(f"cost         {sum(seconds.values()):.1f} CPU-s ({steps})")


@contextlib.contextmanager
def _workspace(keep: str | None) -> Iterator[Path]:
    """Yield the folder for the ground truth: the one to keep, or one that goes away."""
    if keep:
        root = Path(keep).resolve()
        root.mkdir(parents=True, exist_ok=True)
        yield root
        return
    with tempfile.TemporaryDirectory(prefix="objectfolder-") as folder:
        yield Path(folder)
