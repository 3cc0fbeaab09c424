"""Answers and throughput of `objectfolder.batch` on a graphics processor: ``python -m bench.gpu``.

Unattended, within 4 minutes, after nothing but numba-cuda and torch is installed. Each part is written to
``bench/results/gpu.json`` when it is done; one that fails leaves its error there, and the next begins.
``--cpu`` runs every line on a CPU, with small batches; names of parts run those alone, into the file that
``--name`` names.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable
from typing import Any

from bench.gpu.elastic import elastic_equality, elastic_speed
from bench.gpu.fidelity import sight_truth
from bench.gpu.run import KNOWN, LEARNED, Run, objects, versions
from bench.gpu.shear import shear_equality, shear_speed
from bench.gpu.sight import sight_equality, sight_speed
from bench.gpu.sound import hundred_modes, sound
from bench.gpu.stages import sight_stages, touch_stages
from bench.gpu.touch import touch_equality, touch_speed


def hundred_objects(run: Run) -> dict[str, Any]:
    """Memory of a hundred objects with all senses: the four examples, 25 times."""
    from objectfolder.batch import Batch

    if not run.on_cpu:
        run.torch.cuda.empty_cache()
        run.torch.cuda.reset_peak_memory_stats()
        before = run.torch.cuda.memory_allocated()
    batch = Batch(objects((*LEARNED, *KNOWN)) * (1 if run.on_cpu else 25), run.device)
    senses = batch.touch, batch.sound, batch.sight
    if run.on_cpu:
        return {"objects": len(batch.files)}
    gib = (run.torch.cuda.memory_allocated() - before) / 2**30
    return {"objects": len(batch.files), "resident_gib": round(gib, 3), "senses": len(senses)}


def compile_for_cpu() -> None:
    """Fill the cache of compiled kernels that single queries take."""
    file = objects()[1]
    points, _ = file.sample_contacts(1, reachable=False)
    file.press(points)
    file.press(points, contact="elastic")
    file.render(*file.sample_views(1), 16)
    file.strike(points, duration_s=0.1)


def require_card(parser: argparse.ArgumentParser) -> None:
    """End in one line where there is no card, driver or toolkit: recorded results are left as they are."""
    from objectfolder.errors import ObjectFolderError

    try:
        from objectfolder.batch.targets import checked_device

        checked_device("cuda")
    except ObjectFolderError as error:
        parser.exit(1, f"{error}\n")


PARTS: dict[str, Callable[[Run], Any]] = {
    "touch_speed_single": lambda run: touch_speed(run, "single"),
    "elastic_speed": elastic_speed,
    "shear_speed": shear_speed,
    "hundred_modes": hundred_modes,
    "sight_speed": sight_speed,
    "known_sight_speed": lambda run: sight_speed(run, KNOWN),
    "touch_equality_single": lambda run: touch_equality(run, "single", 8 if run.on_cpu else 192),
    "touch_equality_double": lambda run: touch_equality(run, "double", 8 if run.on_cpu else 96),
    "elastic_equality": elastic_equality,
    "shear_equality": shear_equality,
    "sound": sound,
    "sight_equality": sight_equality,
    "known_sight_equality": lambda run: sight_equality(run, KNOWN),
    "touch_stages": touch_stages,
    "sight_stages": sight_stages,
    "known_sight_stages": lambda run: sight_stages(run, KNOWN),
    "hundred_objects": hundred_objects,
    "touch_speed_double": lambda run: touch_speed(run, "double"),
    "sight_truth": sight_truth,
}
# Parts that need a data set run by name alone.
OF_DATA_SET = {"sight_truth"}

# Parts that compare with single queries, whose kernels are compiled by then.
SINGLE_QUERIES = {
    "touch_equality_single",
    "touch_equality_double",
    "elastic_equality",
    "shear_equality",
    "sound",
    "sight_equality",
    "known_sight_equality",
    "sight_truth",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; by default those without a data set"
    )
    parser.add_argument("--name", default="gpu", help="of the file of results")
    parser.add_argument("--cpu", action="store_true", help="run all lines on a CPU")
    parser.add_argument("--compile", action="store_true", help="compile single queries, and nothing else")
    options = parser.parse_args()
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"no part {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    if options.compile:
        return compile_for_cpu()
    if not options.cpu:
        require_card(parser)
    run = Run(options.cpu, options.name)
    names = [name for name in PARTS if name in (options.parts or PARTS.keys() - OF_DATA_SET)]
    # Beside the kernels for the device, which this process compiles meanwhile.
    compiling = subprocess.Popen([sys.executable, "-m", "bench.gpu", "--compile"])
    run.part("versions", versions)
    for name in names:
        if name in SINGLE_QUERIES and "cpu_kernels" not in run.figures:
            run.part("cpu_kernels", lambda run: {"exit": compiling.wait(timeout=400 if run.on_cpu else 100)})
        run.part(name, PARTS[name])
    compiling.wait()
    return None


if __name__ == "__main__":
    main()
