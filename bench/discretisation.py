"""Speed against error of ways to find the modes of a body, on a bowl and on a real scan.

Run as ``python -m bench.discretisation``. Compared, every one from the same triangle surface:

- ours: this project's answer, at several wanted accuracies;
- P1, P2, P3: straight tetrahedra of one order, on our mesh and on pytetwild's own, solved by our solver;
- voxel: the papers' cubes, 16, 32 and 64 along the longest side, touched by the surface or centred inside;
- CalculiX (P2) and NGSolve (P2, P3) on the same meshes: programs of their own, left out where absent;
- LOBPCG as NeuralSound uses it, on cubes and on P2.

The bowl's reference is an axisymmetric solver of the true bowl; the scan's is our own finest answer, which
leaves out what all meshes of the scan have in common. Errors are of undamped frequencies below 20 kHz,
matched in ascending order. Seconds are CPU seconds of the whole way, meshing included.
"""

import argparse
import os
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.discretisation_cases import SCANS, Case, revolution_case, scan_case, tetwild
from bench.discretisation_ours import ours
from bench.discretisation_outcome import MAX_FREQUENCY_HZ, Outcome, Stopwatch, compare
from bench.record import RESULTS, write
from bench.references.bodies import BODIES
from bench.rivals.audio import calculix as rivals_calculix
from bench.rivals.audio import lobpcg as rivals_lobpcg
from bench.rivals.audio import ngsolve_solver as rivals_ngsolve
from bench.rivals.audio.uniform import of_order
from bench.rivals.audio.voxels import voxel_modes
from objectfolder.audio.elements.hierarchic import EDGES
from objectfolder.solid.filling import Filling, fill
from objectfolder.solid.solid import Solid

# Wanted accuracies in cents; the first is the default and the one the bars are about.
ACCURACIES = (5.0, 20.0, 10.0, 2.0, 1.0)
FINEST_CENTS = 0.5
# Three quarters of the edge, half of the distance from the surface and twice its faces.
FINEST_FILLING: dict[str, Any] = {
    "edge_length": 0.075,
    "bulk_elements": 1200,
    "simplification_per_wall": 0.04,
    "target_faces": 1600,
    "most_faces": 3200,
}
ORDERS = (1, 2, 3)
RESOLUTIONS = (16, 32, 64)
# Larger eigenproblems are left out: beyond what this comparison is about.
MOST_UNKNOWNS = 250_000
FIRST_MODES = 50
# Bars of the project.
TIMES_FASTER_THAN_CALCULIX, CALCULIX_AGREEMENT = 4.0, 1e-3
TIMES_BETTER_THAN_VOXELS, TIMES_SLOWER_THAN_VOXELS = 100.0, 3.0

Way = tuple[str, Callable[[], Outcome]]


class Meshes:
    """Our mesh and pytetwild's of a surface, each made once and its seconds added to every way that uses
    it."""

    def __init__(self, case: Case) -> None:
        self._case = case
        self._made: dict[str, tuple[Solid, float]] = {}

    def __call__(self, kind: str) -> tuple[Solid, float]:
        if kind not in self._made:
            watch = Stopwatch()
            with watch.step("meshing"):
                surface = self._case.surface
                solid = fill(surface, name=self._case.name) if kind == "our mesh" else tetwild(surface)
            self._made[kind] = solid, watch.cpu_s["meshing"]
        return self._made[kind]

    def using(self, kind: str, solve: Callable[[Solid], Outcome]) -> Callable[[], Outcome]:
        def run() -> Outcome:
            solid, seconds = self(kind)
            outcome = solve(solid)
            outcome.cpu_s = {"meshing": seconds, **outcome.cpu_s}
            return outcome

        return run


def ways(case: Case, meshes: Meshes, ngsolve_python: str | None) -> Iterator[Way]:
    """Every way by name."""
    surface, material = case.surface, case.material
    for cents in ACCURACIES:
        yield f"ours, {cents:g} cents", partial(ours, surface, material, case.name, accuracy_cents=cents)
    for resolution in RESOLUTIONS:
        for rule in ("touch", "centre"):
            yield f"voxel {resolution}^3 {rule}", partial(of_voxels, case, resolution, rule)
    for kind in ("our mesh", "pytetwild's mesh"):
        on_mesh: list[tuple[str, Callable[[Solid], Outcome]]] = [
            (f"P{order}", partial(of_order, material=material, order=order)) for order in ORDERS
        ]
        if rivals_calculix.available():
            calculix = partial(rivals_calculix.calculix, material=material, modes=FIRST_MODES)
            on_mesh.append(("CalculiX P2", calculix))
        if ngsolve_python and rivals_ngsolve.available(ngsolve_python):
            by_ngsolve = partial(rivals_ngsolve.ngsolve, ngsolve_python, material=material, modes=FIRST_MODES)
            on_mesh += [(f"NGSolve P{order}", partial(by_ngsolve, order=order)) for order in (2, 3)]
        for name, solve in on_mesh:
            if unknowns(meshes(kind)[0], int(name[-1])) <= MOST_UNKNOWNS:
                yield f"{name}, {kind}", meshes.using(kind, solve)
            else:
                print(f"{case.name}: {name}, {kind} is left out, more than {MOST_UNKNOWNS} unknowns")
    for preconditioner in rivals_lobpcg.PRECONDITIONERS:
        on_cubes = partial(rivals_lobpcg.on_voxels, surface, material, 32, preconditioner)
        yield f"LOBPCG, {preconditioner}, voxel 32^3", on_cubes
        quadratic = partial(
            rivals_lobpcg.on_tetrahedra, material=material, order=2, preconditioner=preconditioner
        )
        yield f"LOBPCG, {preconditioner}, P2, our mesh", meshes.using("our mesh", quadratic)


def unknowns(solid: Solid, order: int) -> int:
    """Size of the eigenproblem on tetrahedra of an order, 1 to 3: corners, edges and faces."""
    edges = len(np.unique(np.sort(solid.tetrahedra[:, EDGES].reshape(-1, 2), axis=1), axis=0))
    faces = (4 * len(solid.tetrahedra) + len(solid.boundary()[0])) // 2
    return 3 * (len(solid.vertices) + (order - 1) * edges + (order - 1) * (order - 2) // 2 * faces)


def of_voxels(case: Case, resolution: int, rule: str) -> Outcome:
    modes = voxel_modes(
        case.surface, case.material, resolution=resolution, rule=rule, max_frequency_hz=MAX_FREQUENCY_HZ
    )
    names = {"voxelise": "meshing", "assemble": "assembly", "count": "certificate"}
    seconds = {names.get(step, "factorisation and eigenvectors"): s for step, s in modes.cpu_s.items()}
    return Outcome(
        np.sqrt(modes.eigenvalues) / (2 * np.pi),
        modes.unknowns,
        seconds,
        {"bodies": modes.components, "mass_ratio": modes.mass_ratio, "elements": modes.cells},
    )


def duel_with_calculix(solid: Solid, case: Case) -> dict[str, Any]:
    """The first modes of one P2 mesh by CalculiX and by our solver: the same matrices but for CalculiX's
    mass.

    CalculiX integrates the mass of a C3D10 by a rule that is not exact; the two agree as the mesh is fine.
    """
    own = of_order(solid, case.material, 2, FIRST_MODES)
    theirs = rivals_calculix.calculix(solid, case.material, FIRST_MODES)
    count = min(len(own.frequencies_hz), len(theirs.frequencies_hz), FIRST_MODES)
    apart = np.abs(theirs.frequencies_hz[:count] / own.frequencies_hz[:count] - 1)
    ratio = theirs.total_cpu_s / own.total_cpu_s
    return {
        "modes": count,
        "elements": len(solid.tetrahedra),
        "unknowns": own.unknowns,
        "ours_cpu_s": own.cpu_s,
        "calculix_cpu_s": theirs.cpu_s,
        "times_faster": ratio,
        "largest_relative_difference": float(apart.max()),
        "median_relative_difference": float(np.median(apart)),
        "meets_bar": bool(ratio >= TIMES_FASTER_THAN_CALCULIX and apart.max() <= CALCULIX_AGREEMENT),
    }


def finest(case: Case) -> tuple[np.ndarray, dict[str, Any]]:
    """Our own answer with a finer mesh nearer to the surface."""
    outcome = ours(
        case.surface, case.material, case.name, Filling(**FINEST_FILLING), accuracy_cents=FINEST_CENTS
    )
    said = {"unknowns": outcome.unknowns, "cpu_s": outcome.cpu_s, **outcome.notes}
    return outcome.frequencies_hz, {"by": "this project's finest answer, not independent", **said}


def measure(case: Case, options: argparse.Namespace) -> dict[str, Any]:
    """All ways on one case, and the bars."""
    if case.reference_hz is None:
        reference, about = finest(case)
    else:
        reference, about = case.reference_hz, {"by": "axisymmetric Fourier p-FEM of the true body"}
    meshes = Meshes(case)
    result: dict[str, Any] = {
        "material": case.material.name,
        "faces": len(case.surface.faces),
        "reference": {**about, "modes": int(np.count_nonzero(reference < MAX_FREQUENCY_HZ))},
        "ways": {},
    }
    for name, run in ways(case, meshes, options.ngsolve_python):
        if not re.search(options.ways, name):
            continue
        outcome = run()
        figures = {
            **compare(outcome.frequencies_hz, reference),
            "unknowns": outcome.unknowns,
            "cpu_s": outcome.cpu_s,
            "total_cpu_s": outcome.total_cpu_s,
            **outcome.notes,
        }
        result["ways"][name] = figures
        print(f"{case.name:10} {line(name, figures)}", flush=True)
    if rivals_calculix.available() and re.search(options.ways, "duel with CalculiX"):
        result["duel with CalculiX"] = duel_with_calculix(meshes("pytetwild's mesh")[0], case)
        print(result["duel with CalculiX"], flush=True)
    own, voxels = (
        result["ways"].get(name) for name in (f"ours, {ACCURACIES[0]:g} cents", "voxel 32^3 touch")
    )
    if own and voxels:
        better = voxels["median_cents"] / own["median_cents"]
        slower = own["total_cpu_s"] / voxels["total_cpu_s"]
        result["against voxel 32^3 touch"] = {
            "times_better": better,
            "times_slower": slower,
            "times_slower_without_meshing": sum(s for k, s in own["cpu_s"].items() if k != "meshing")
            / sum(s for k, s in voxels["cpu_s"].items() if k != "meshing"),
            "meets_bar": bool(better >= TIMES_BETTER_THAN_VOXELS and slower <= TIMES_SLOWER_THAN_VOXELS),
        }
        print(result["against voxel 32^3 touch"], flush=True)
    return result


def line(name: str, figures: dict[str, Any]) -> str:
    """A line of the table."""
    seconds = " ".join(f"{step} {value:.2f}" for step, value in figures["cpu_s"].items())
    if "compared" not in figures:
        return f"{name:38} {figures['unknowns']:8} no mode to compare   {seconds}"
    return (
        f"{name:38} {figures['unknowns']:8} {figures['total_cpu_s']:8.2f} CPU-s  modes {figures['modes']:3}/"
        f"{figures['modes_of_reference']:3}  first {figures['first_error_percent']:+8.3f} %  median "
        f"{figures['median_cents']:8.2f}  worst {figures['worst_cents']:8.2f} cents   {seconds}"
    )


FAMILIES = (
    ("ours", "o-", "C3"),
    ("voxel .* touch", "s-", "C0"),
    ("voxel .* centre", "s--", "C9"),
    ("P., our mesh", "^-", "C2"),
    ("P., pytetwild", "v-", "C1"),
    ("CalculiX", "D", "C4"),
    ("NGSolve", "P", "C5"),
    ("LOBPCG", "x", "C7"),
)


def plot(figures: dict[str, Any], path: Path) -> None:
    """Median error over seconds, a panel a body, a line a way over its settings."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, len(figures), figsize=(8 * len(figures), 6), squeeze=False)
    for panel, (case, found) in zip(axes[0], figures.items(), strict=True):
        for pattern, style, colour in FAMILIES:
            rows = [
                (way["total_cpu_s"], way["median_cents"], name)
                for name, way in found["ways"].items()
                if re.match(pattern, name) and way.get("median_cents")
            ]
            if not rows:
                continue
            rows.sort()
            seconds, cents, _ = zip(*rows, strict=True)
            label = pattern.replace(" .*", "").replace("P.", "P1, P2, P3")
            panel.plot(seconds, cents, style, color=colour, label=label, ms=6, lw=1)
            for x, y, name in rows:
                short = re.sub(r"^(ours|voxel|CalculiX|NGSolve|LOBPCG),? ", "", name).split(",")[0]
                panel.annotate(short, (x, y), fontsize=7, xytext=(4, 4), textcoords="offset points")
        panel.axhline(5, color="0.7", lw=0.8)
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_xlabel("CPU seconds, meshing included")
        panel.set_ylabel("median frequency error, cents")
        panel.set_title(f"{case}: {found['reference']['modes']} audible modes")
        panel.grid(alpha=0.3, which="both")
        panel.legend(fontsize=9)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scans", type=Path, default=SCANS, help="folder of scans with catalogue.csv")
    parser.add_argument("--objects", nargs="*", default=["025_mug"], help="scans to compare on")
    parser.add_argument("--ways", default="", help="regular expression: only ways whose name has it")
    parser.add_argument(
        "--ngsolve-python", default=os.environ.get("NGSOLVE_PYTHON"), help=f"e.g. {rivals_ngsolve.HOW}"
    )
    options = parser.parse_args()
    absent = []
    if not rivals_calculix.available():
        absent.append(f"CalculiX ({rivals_calculix.HOW})")
    if not rivals_ngsolve.available(options.ngsolve_python):
        absent.append(f"NGSolve ({rivals_ngsolve.HOW})")
    if not (options.scans / "catalogue.csv").exists():
        absent.append("scans (--scans FOLDER, with catalogue.csv)")
        options.objects = []
    for name in absent:
        print(f"left out, as it is absent: {name}", flush=True)
    settings = {
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "accuracies_cents": ACCURACIES,
        "first_modes_of_rivals": FIRST_MODES,
        "most_unknowns": MOST_UNKNOWNS,
        "lobpcg_modes": rivals_lobpcg.MODES,
        "finest": {"accuracy_cents": FINEST_CENTS, **FINEST_FILLING},
        "left_out": absent,
    }
    figures: dict[str, Any] = {}
    for name in ("bowl", *options.objects):
        case = revolution_case(name) if name in BODIES else scan_case(name, options.scans)
        figures[case.name] = measure(case, options)
        write(
            "discretisation",
            figures,
            settings,
            "undamped frequencies below the limit in ascending order against the reference; CPU seconds by "
            "step, children included; CalculiX, NGSolve and LOBPCG were asked for their first modes only",
        )
        plot(figures, RESULTS / "discretisation.png")


if __name__ == "__main__":
    main()
