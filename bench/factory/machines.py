"""The same tasks under other conditions and on another processor: which arrays differ, and by how much.

Run as ``python -m bench machines --work FOLDER``. Each stage makes objects of the starter set in a
process of its own, and again under each of `CONDITIONS`, on inputs that are the same. Another vendor's
processor is emulated by QEMU (Debian's ``qemu-user``): CPUID answers as an Intel Haswell does, so every
library takes the path it takes there, and approximate reciprocals are rounded otherwise than by this
processor.

``--data FOLDER`` compares the products of a whole data set that was made on another machine, a folder with
``data/``, with those of this repository. Products in FOLDER are kept by a second run.
"""

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib import colormaps
from matplotlib.patches import Rectangle

from bench.record import REPOSITORY, arguments, conclude, save, subplots
from pipeline.audit.reproducibility import ATTRIBUTE, EQUAL, compare
from pipeline.dataset.stages import STAGES
from pipeline.intake.starter.write import write_starter_set
from pipeline.sandbox.isolation import instruction_settings

# As in children of the factory (`pipeline.sandbox.isolation`).
USUAL = {
    **instruction_settings(),
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "NUMBA_NUM_THREADS": "1",
    "OMP_WAIT_POLICY": "PASSIVE",
    "PYTHONHASHSEED": "0",
}
TWO = {name: "2" for name in USUAL if name.endswith("THREADS")}
# QEMU has no such instructions, and says so at every start.
LACKING = "-pcid,-x2apic,-tsc-deadline,-invpcid,-spec-ctrl"
SMALLEST: dict[str, dict[str, Any]] = {
    "vision": {"resolution": 32, "training_views": 8, "training_samples": 4, "held_out_views": 2,
               "held_out_samples": 16},
    "audio": {"training_points": 500, "held_out_points": 50},
    "touch": {"touches": 4, "held_out_touches": 4},
    "encode": {"visionnet": {"steps": 60}},
}  # fmt: skip


@dataclass(frozen=True)
class Condition:
    """How a process differs from the factory's.

    Parameters
    ----------
    says
        What is different, in words.
    environment
        Variables added.
    processor
        Processor that QEMU emulates, as its option ``-cpu`` names it; none if empty.
    times
        Runs in the same process, of which the last counts.
    elsewhere
        Work in another current folder, with another temporary one.
    """

    says: str
    environment: dict[str, str] = field(default_factory=dict)
    processor: str = ""
    times: int = 1
    elsewhere: bool = False


CONDITIONS = {
    "again": Condition("nothing: a second process"),
    "recycled": Condition("a child that ran the same tasks before", times=2),
    "surroundings": Condition(
        "hash seed, locale, time zone, current and temporary folder",
        {"PYTHONHASHSEED": "77", "LC_ALL": "C", "LANG": "de_DE.UTF-8", "TZ": "Pacific/Auckland"},
        elsewhere=True,
    ),
    "two threads": Condition("OpenMP, OpenBLAS, MKL, numba and torch with two threads", TWO),
    "Haswell": Condition("an emulated Intel processor with AVX2", processor=f"Haswell-v4,{LACKING}"),
}


class Workplace:
    """Where products of all conditions lie: ``usual`` and a folder a condition.

    Parameters
    ----------
    folder
        Everything is below it.
    size
        ``smallest`` or ``default``.
    """

    def __init__(self, folder: Path, size: str) -> None:
        self.folder = folder / size
        self.usual = self.folder / "usual"
        (self.usual / "data").mkdir(parents=True, exist_ok=True)
        if not (self.usual / "params.yaml").exists():
            write_starter_set(self.usual / "data" / "starter")
            for name in ("starter.csv", "materials.csv"):
                shutil.copy(REPOSITORY / "data" / name, self.usual / "data" / name)
            (self.usual / "params.yaml").write_text(yaml.safe_dump(parameters(size)))

    def outputs(self, condition: str) -> Path:
        """Return the root of what a condition made."""
        return self.folder / condition.replace(" ", "_")

    def make_usual(self, object_id: str) -> None:
        """Make what all else is compared with: as the factory does, each stage in a process of its own."""
        log = self.usual / f"{object_id}.json"
        if not log.exists():
            usual = Condition("nothing")
            done = {stage: self._run(usual, self.usual, object_id, stage) for stage in STAGES}
            log.write_text(json.dumps(done, indent=1))

    def make(self, object_id: str, name: str, stages: list[str]) -> None:
        """Make the products of some stages under a condition, on the usual inputs."""
        outputs = self.outputs(name)
        outputs.mkdir(parents=True, exist_ok=True)
        log = outputs / f"{object_id}.json"
        done: dict[str, Any] = json.loads(log.read_text()) if log.exists() else {}
        for stage in stages:
            if stage not in done:
                done[stage] = self._run(CONDITIONS[name], outputs, object_id, stage)
                log.write_text(json.dumps(done, indent=1))
        print(name, object_id, {stage: round(entry["cpu_s"], 1) for stage, entry in done.items()}, flush=True)

    def _run(self, condition: Condition, outputs: Path, object_id: str, stage: str) -> dict[str, Any]:
        """Run one stage in a process of its own; what it cost."""
        place = self.folder / "elsewhere"
        place.mkdir(exist_ok=True)
        environment = {**os.environ, **USUAL, **condition.environment, "PYTHONPATH": str(REPOSITORY)}
        python = Path(sys.executable)
        if condition.processor:
            python = emulated(self.folder / "emulated", condition.processor)
            environment["NUMBA_CACHE_DIR"] = str(self.folder / "emulated" / "kernels")
        if condition.elsewhere:
            environment["TMPDIR"] = str(place)
        named = [str(self.usual), str(outputs), object_id, stage, str(condition.times)]
        done = subprocess.run(
            [str(python), "-m", "bench.factory.machines_run", *named],
            cwd=place if condition.elsewhere else REPOSITORY,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        outcome: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        if outcome["failure"]:
            raise RuntimeError(f"{condition.says}, {stage}: {outcome['failure']}")
        return outcome


def emulated(folder: Path, processor: str) -> Path:
    """Return a Python that runs, with all that it starts, on an emulated processor.

    Raises
    ------
    FileNotFoundError
        No emulator is installed.
    """
    emulator = shutil.which("qemu-x86_64")
    if emulator is None:
        raise FileNotFoundError("qemu-x86_64 is not installed: on Debian `apt-get install qemu-user`")
    python = folder / "bin" / "python"
    if not python.exists():
        python.parent.mkdir(parents=True)
        # What makes a folder a virtual environment: Python names its own place `sys.executable`.
        shutil.copy(Path(sys.prefix) / "pyvenv.cfg", folder)
        (folder / "lib").symlink_to(Path(sys.prefix) / "lib")
        real = os.path.realpath(sys.executable)
        python.write_text(f'#!/bin/sh\nexec {emulator} -cpu {processor} -0 "$0" {real} "$@"\n')
        python.chmod(0o755)
    return python


def compared(usual: Path, root: Path, object_id: str) -> dict[str, Any]:
    """Compare two roots' products of an object: by stage, all that is not the same bytes."""
    comparisons: dict[str, Any] = {}
    for stage in STAGES.values():
        pairs = list(zip(stage.targets(usual, object_id), stage.targets(root, object_id), strict=True))
        if not all(path.exists() for pair in pairs for path in pair):
            continue
        entries = [entry for pair in pairs for entry in compare(*pair, stage.tolerances)]
        apart = {
            entry.name: {
                "verdict": entry.verdict,
                "largest": _finite(entry.largest),
                "largest_of_range": _finite(entry.relative),
                "rms_of_range": _finite(entry.rms),
            }
            for entry in entries
            if entry.verdict != EQUAL
        }
        comparisons[stage.name] = {"compared": len(entries), "apart": apart}
    return comparisons


def _finite(value: float) -> float | None:
    """The number; None for one that is not finite: what cannot be subtracted."""
    return value if math.isfinite(value) else None


def draw(figures: Mapping[str, Any]) -> None:
    """Largest difference of an array, as a share of its range, by condition and stage."""
    keys, stages = list(figures), list(STAGES)
    figure, axes = subplots(figsize=(9, 1.2 + 0.3 * len(keys)))
    for row, key in enumerate(keys):
        for column, stage in enumerate(stages):
            if stage not in figures[key]:
                continue
            apart = figures[key][stage]["apart"]
            arrays = [
                entry["rms_of_range"] for name, entry in apart.items() if not name.startswith(ATTRIBUTE)
            ]
            worst = max((1.0 if value is None else value for value in arrays), default=0.0)
            text = f"{worst:.0e}" if worst else ("same arrays" if apart else "same bytes")
            shade = 0.0 if not worst else min(1.0, max(0.1, 1 + math.log10(worst) / 16))
            axes.add_patch(Rectangle((column, row), 1, 1, color=colormaps["Oranges"](shade * 0.8)))
            axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=8)
    axes.set_xlim(0, len(stages))
    axes.set_ylim(len(keys), 0)
    axes.set_xticks(np.arange(len(stages)) + 0.5, stages)
    axes.set_yticks(np.arange(len(keys)) + 0.5, keys, fontsize=8)
    axes.xaxis.tick_top()
    axes.set_title("worst array of a stage: rms of its differences as a share of its range", fontsize=10)
    save(figure, "machines")


def parameters(size: str) -> dict[str, Any]:
    """Return the parameters of the repository, with the smallest size among them."""
    content = yaml.safe_load((REPOSITORY / "params.yaml").read_text())
    default = content["sizes"]["default"]
    content["sizes"]["smallest"] = {
        section: {**values, **SMALLEST[section]} for section, values in default.items()
    }
    content["size"] = size
    return dict(content)


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--work", type=Path, required=True, help="folder for products")
    parser.add_argument("--objects", nargs="+", default=["die", "fork"])
    parser.add_argument("--size", default="smallest", choices=("smallest", "default"))
    parser.add_argument("--conditions", nargs="*", default=list(CONDITIONS), choices=list(CONDITIONS))
    parser.add_argument("--stages", nargs="+", default=list(STAGES), choices=list(STAGES))
    parser.add_argument("--data", type=Path, help="a data set made on another machine")
    parser.add_argument("--data-made-on", default="another machine", help="its processor, in words")
    options = parser.parse_args()
    place = Workplace(options.work.resolve(), options.size)
    figures: dict[str, Any] = {}
    for object_id in options.objects:
        place.make_usual(object_id)
        for name in options.conditions:
            place.make(object_id, name, options.stages)
            figures[f"{object_id}, {options.size}, {name}"] = compared(
                place.usual, place.outputs(name), object_id
            )
        if options.data is not None:
            key = f"{object_id}, default, {options.data_made_on}"
            figures[key] = compared(REPOSITORY, options.data, object_id)
    settings = {
        "smallest": SMALLEST,
        "conditions": {name: asdict(condition) for name, condition in CONDITIONS.items()},
        "order": "each stage in a process of its own, as the factory does where MKL would change torch",
    }
    conclude(
        "machines",
        figures,
        settings,
        "products made under another condition from the same inputs, or by another machine from the same "
        "code, against the usual ones: arrays and attributes that are not the same bytes, with "
        "the largest and rms difference as a share of the range of the array",
        draw,
    )
