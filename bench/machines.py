"""The same tasks on machines of different kind: which arrays are the same bytes, how far apart are others.

Run as ``python -m bench.machines --work FOLDER``. Every stage of the factory makes objects of the starter
set, each time in processes of their own, as `bench.machines_conditions` says. Stages are compared on
identical inputs first (``own``), then as chains in which each reads what the same machine made before
(``chain``). Processors are disguised (``machines_disguise.c``): CPUID answers as theirs would, so every
library takes the path it would take there. Products lie in FOLDER and are kept by a second run.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.machines_conditions import CONDITIONS, MACHINES, USUAL, Condition
from bench.record import RESULTS, write
from objectfolder.geometry.starter.write import write_starter_set
from pipeline.reproducibility import ATTRIBUTE, EQUAL, compare
from pipeline.stages import STAGES

SIZES, WAYS = ("smallest", "default"), ("own", "chain")
REPOSITORY = Path(__file__).parents[1]
DISGUISE = Path(__file__).with_name("machines_disguise.c")
SMALLEST: dict[str, dict[str, Any]] = {
    "vision": {"resolution": 32, "training_views": 8, "training_samples": 4, "held_out_views": 2,
               "held_out_samples": 16},
    "audio": {"training_points": 500, "held_out_points": 50},
    "touch": {"touches": 4, "held_out_touches": 4},
    "encode": {"visionnet": {"steps": 60}},
}  # fmt: skip


class Workplace:
    """Where products of all conditions lie.

    Parameters
    ----------
    folder
        Everything is below it.
    size
        ``smallest`` or ``default``.
    """

    def __init__(self, folder: Path, size: str) -> None:
        self.folder = folder / size
        self.disguise = folder / "disguise.so"
        self.compiled = folder / "numba"
        self.root = self.folder / "usual"
        (self.root / "data").mkdir(parents=True, exist_ok=True)
        if not (self.root / "params.yaml").exists():
            write_starter_set(self.root / "data" / "starter")
            for name in ("starter.csv", "materials.csv"):
                (self.root / "data" / name).write_bytes((REPOSITORY / "data" / name).read_bytes())
            (self.root / "params.yaml").write_text(yaml.safe_dump(parameters(size)))
        if not self.disguise.exists():
            subprocess.run(
                ["cc", "-O1", "-shared", "-fPIC", "-o", str(self.disguise), str(DISGUISE)], check=True
            )

    def outputs(self, condition: str, way: str) -> Path:
        """Return the root of what a condition made, ``own`` or ``chain``."""
        return self.folder / way / condition.replace(" ", "_")

    def make(self, object_id: str, name: str, way: str, stages: list[str]) -> dict[str, dict[str, Any]]:
        """Make all products of an object under a condition; what each stage cost, or why it failed."""
        outputs = self.outputs(name, way)
        log = outputs / f"{object_id}.json"
        done: dict[str, dict[str, Any]] = json.loads(log.read_text()) if log.exists() else {}
        stages = [stage for stage in stages if stage not in done]
        if not stages:
            return done
        outputs.mkdir(parents=True, exist_ok=True)
        inputs = self.root
        if way == "chain":
            inputs = outputs
            for shared in ("params.yaml", "data"):
                if not (outputs / shared).exists():
                    self._share(outputs, shared)
        done |= self._run(CONDITIONS[name], inputs, outputs, object_id, stages)
        log.write_text(json.dumps(done, indent=1))
        print(
            name,
            way,
            object_id,
            {stage: round(entry["cpu_s"], 1) for stage, entry in done.items()},
            flush=True,
        )
        return done

    def make_usual(self, object_id: str) -> dict[str, dict[str, Any]]:
        """Make what all else is compared with: as the factory does, each stage in a process of its own."""
        log = self.root / f"{object_id}.json"
        if log.exists():
            return dict(json.loads(log.read_text()))
        usual = Condition("nothing")
        done: dict[str, dict[str, Any]] = {}
        for stage in STAGES:
            done |= self._run(usual, self.root, self.root, object_id, [stage])
        log.write_text(json.dumps(done, indent=1))
        print(
            "usual", object_id, {stage: round(entry["cpu_s"], 1) for stage, entry in done.items()}, flush=True
        )
        return done

    def _share(self, outputs: Path, name: str) -> None:
        if name == "params.yaml":
            (outputs / name).write_bytes((self.root / name).read_bytes())
            return
        (outputs / name).mkdir()
        for part in ("starter", "starter.csv", "materials.csv"):
            (outputs / name / part).symlink_to(self.root / name / part)

    def _run(
        self, condition: Condition, inputs: Path, outputs: Path, object_id: str, stages: list[str]
    ) -> dict[str, dict[str, Any]]:
        place = self.folder / "elsewhere"
        place.mkdir(exist_ok=True)
        kept = {key: value for key, value in os.environ.items() if not key.endswith("THREADS")}
        environment = {**kept, **USUAL, **condition.variables(self.disguise, self.compiled)}
        environment["PYTHONPATH"] = str(REPOSITORY)
        if condition.elsewhere:
            environment["TMPDIR"] = str(place)
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "bench.machines_run",
                *map(str, (inputs, outputs, object_id)),
                ",".join(stages),
                str(condition.times),
            ],
            cwd=place if condition.elsewhere else REPOSITORY,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        if done.returncode or len(lines) != len(stages):
            raise RuntimeError(f"{condition.says}: {done.returncode}\n{done.stderr[-3000:]}")
        for line in lines:
            if line["failure"]:
                raise RuntimeError(f"{condition.says}, {line['stage']}: {line['failure']}")
        return {line.pop("stage"): line for line in lines}


def compared(place: Workplace, way: str, name: str, object_id: str) -> dict[str, Any]:
    """Compare what a condition made of an object with the usual: by stage, all that is not the same bytes."""
    found: dict[str, Any] = {}
    for stage in STAGES.values():
        usual, others = (stage.targets(root, object_id) for root in (place.root, place.outputs(name, way)))
        pairs = [pair for pair in zip(usual, others, strict=True) if all(path.exists() for path in pair)]
        if len(pairs) < len(others):
            continue
        entries = [entry for pair in pairs for entry in compare(*pair, stage.name)]
        apart = {
            entry.name: {
                "verdict": entry.verdict,
                "largest": finite(entry.largest),
                "largest_of_range": finite(entry.relative),
                "rms_of_range": finite(entry.rms),
            }
            for entry in entries
            if entry.verdict != EQUAL
        }
        found[stage.name] = {
            "compared": len(entries),
            "same_bytes": len(entries) - len(apart),
            "apart": apart,
        }
    return found


def finite(value: float) -> float | None:
    """The number; None for one that is not finite: what cannot be subtracted."""
    return value if math.isfinite(value) else None


def gather(folder: Path) -> dict[str, Any]:
    """Compare all products of all sizes, ways, conditions and objects in a folder."""
    figures: dict[str, Any] = {}
    for size in SIZES:
        if not (folder / size / "usual").is_dir():
            continue
        place = Workplace(folder, size)
        for way in WAYS:
            for name in CONDITIONS:
                made = place.outputs(name, way).glob("data/*/*.*")
                for object_id in sorted({path.name.split(".")[0] for path in made if path.is_file()}):
                    key = f"{object_id}, {size}, {way}, {name}"
                    figures[key] = compared(place, way, name, object_id)
    return {key: value for key, value in figures.items() if value}


def plot(figures: dict[str, Any], path: Path) -> None:
    """Largest difference of an array, as a share of its range, by condition and stage."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    keys, stages = list(figures), list(STAGES)
    figure, axes = pyplot.subplots(figsize=(9, 1.2 + 0.3 * len(keys)))
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
            axes.add_patch(
                pyplot.Rectangle((column, row), 1, 1, color=pyplot.get_cmap("Oranges")(shade * 0.8))
            )
            axes.text(column + 0.5, row + 0.5, text, ha="center", va="center", fontsize=8)
    axes.set_xlim(0, len(stages))
    axes.set_ylim(len(keys), 0)
    axes.set_xticks(np.arange(len(stages)) + 0.5, stages)
    axes.set_yticks(np.arange(len(keys)) + 0.5, keys, fontsize=8)
    axes.xaxis.tick_top()
    axes.set_title("worst array of a stage: rms of its differences as a share of its range", fontsize=10)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def parameters(size: str) -> dict[str, Any]:
    """Return the parameters of the repository, with the smallest size among them."""
    content = yaml.safe_load((REPOSITORY / "params.yaml").read_text())
    default = content["sizes"]["default"]
    smallest = {section: {**values, **SMALLEST[section]} for section, values in default.items()}
    content["sizes"]["smallest"] = smallest
    content["size"] = size
    content["objects"]["only"] = []
    return dict(content)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--work", type=Path, required=True, help="folder for products; what lies there is compared"
    )
    parser.add_argument("--objects", nargs="*", default=["die", "fork", "bell"])
    parser.add_argument("--size", default="smallest", choices=("smallest", "default"))
    parser.add_argument("--conditions", nargs="*", default=list(CONDITIONS), choices=list(CONDITIONS))
    parser.add_argument("--chains", nargs="*", default=list(MACHINES), choices=list(CONDITIONS))
    parser.add_argument("--stages", nargs="+", default=list(STAGES), choices=list(STAGES))
    options = parser.parse_args()
    place = Workplace(options.work.resolve(), options.size)
    for object_id in options.objects:
        place.make_usual(object_id)
        for way, names in (("own", options.conditions), ("chain", options.chains)):
            for name in names:
                place.make(object_id, name, way, options.stages)
    figures = gather(options.work.resolve())
    settings = {
        "smallest": SMALLEST,
        "conditions": {name: asdict(condition) for name, condition in CONDITIONS.items()},
        "order": "all stages of a condition in one process, except where it made only some of them",
    }
    write(
        "machines",
        figures,
        settings,
        "products of the same fingerprint, made under another condition, against those of one process a "
        "stage: arrays and attributes that are not the same bytes, with the largest and rms difference as a "
        "share of the range of the array; own: on identical inputs; chain: on what the same condition made",
    )
    plot(figures, RESULTS / "machines.png")


if __name__ == "__main__":
    main()
