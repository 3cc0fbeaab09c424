"""Speed against error of ways to find the modes of a body, and what each part of this project's way brings.

Run as ``python -m bench.senses.discretisation --folder FOLDER``. Rows of bodies are kept in FOLDER and not
measured again. Every way starts from the same triangle surface:

- ours, and ours with a part switched off: straight elements in place of bent ones, or one order everywhere;
- P2, P3: straight tetrahedra of one order on the mesh that pytetwild makes as it comes;
- on the bowl also ours at other accuracies, the papers' cubes, and CalculiX, NGSolve and LOBPCG (as
  NeuralSound uses it) on the same tetrahedra. A program that is not installed is left out, and named.

The reference of a body of revolution is an axisymmetric solution of the true body (`tests.references`), which
shares no code with the solver; that of a scan is our own finest answer, so what all meshes of the scan have
in common stays hidden. Errors are of undamped frequencies below 20 kHz, matched in ascending order. Seconds
are CPU seconds of the whole way, meshing included.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import Stopwatch, arguments, conclude, kept, save, subplots
from bench.rivals.audio import calculix, lobpcg, ngsolve_solver
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, Outcome, compare
from bench.rivals.audio.uniform import MAX_MODES, of_order
from bench.rivals.audio.voxels import voxel_modes
from bench.senses.catalogue import FOLDER, MATERIALS, Scans
from objectfolder.audio.elements.space import Space
from objectfolder.audio.materials import Material, read_materials
from objectfolder.audio.modes.modes import modes_of_solid, waves_of
from objectfolder.solid.bending_waves import BendingWaves
from objectfolder.solid.filling import Filling, fill
from objectfolder.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface
from tests.references.bodies import BODIES

# Cents asked for on the bowl beside the default, and of the finest answer.
ACCURACIES, FINEST_CENTS = (1.0, 2.0, 10.0, 20.0), 0.5
# Three quarters of the edge, half of the distance from the surface and twice its faces.
FINEST_FILLING: dict[str, Any] = {
    "edge_length": 0.075,
    "bulk_elements": 1200,
    "simplification_per_wall": 0.04,
    "target_faces": 1600,
    "most_faces": 3200,
}
RESOLUTIONS = (16, 32, 64)
# Larger eigenproblems are left out: beyond what this comparison is about.
MOST_UNKNOWNS = 250_000
FIRST_MODES = 50
SCANS = ("025_mug", "031_spoon")
OURS, RIVAL_BODY = "ours", "bowl"
TETWILD = """
import numpy, pytetwild
given = numpy.load("in.npz")
vertices, tetrahedra = pytetwild.tetrahedralize(given["vertices"], given["faces"], num_threads=1, quiet=True)
numpy.savez("out.npz", vertices=vertices, tetrahedra=tetrahedra)
"""
COMPARED = (
    "undamped frequencies below the limit in ascending order against the reference, cents; CPU seconds by "
    "step, children included; CalculiX, NGSolve and LOBPCG were asked for their first modes only"
)
FAMILIES = (
    (r"ours(, \d+ cents)?$", "o-", "C3"),
    ("ours, straight elements", "o", "C1"),
    ("ours, order", "o", "C2"),
    ("P., pytetwild", "v-", "C0"),
    ("voxel .* touch", "s-", "C9"),
    ("voxel .* centre", "s--", "C8"),
    ("CalculiX", "D", "C4"),
    ("NGSolve", "P", "C5"),
    ("LOBPCG", "x", "C7"),
)


@dataclass(frozen=True)
class Case:
    """A body to be solved.

    Attributes
    ----------
    name, surface, material : of the body
    reference_hz : undamped frequencies of its audible modes
    reference : what they are, JSON-able
    """

    name: str
    surface: Surface
    material: Material
    reference_hz: np.ndarray
    reference: dict[str, Any]


def case_of(name: str, scans: Path) -> Case:
    """A body of revolution with its axisymmetric reference, or a scan with our finest answer."""
    watch = Stopwatch()
    if name in BODIES:
        body = BODIES[name]()
        material, surface = read_materials(MATERIALS)[body.material], body.surface()
        with watch.step("reference"):
            truth = body.spectrum(material, MAX_FREQUENCY_HZ)
        found = truth.frequencies_hz(material)
        said = {"by": "axisymmetric Fourier p-FEM of the true body", "convergence": truth.convergence}
    else:
        catalogue = Scans(scans / "catalogue.csv")
        material, surface = catalogue.material(name), catalogue.surface(name)
        with watch.step("reference"):
            solid = fill(surface, Filling(**FINEST_FILLING), waves=audible_waves(material), name=name)
            finest = ours(solid, surface, material, accuracy_cents=FINEST_CENTS)
        found = finest.frequencies_hz
        said = {"by": "this project's finest answer, not independent", **finest.notes}
    audible = found[found < MAX_FREQUENCY_HZ]
    said |= {
        "modes": len(audible),
        "last_mode_below_the_limit_cents": float(1200 * np.log2(MAX_FREQUENCY_HZ / audible[-1])),
        "cpu_s": watch.cpu_s["reference"],
    }
    return Case(name, surface, material, found, said)


def audible_waves(material: Material) -> BendingWaves:
    """Waves that any caller's solid has to carry."""
    return waves_of(material, MAX_FREQUENCY_HZ, MAX_MODES)


def ours(solid: Solid, surface: Surface, material: Material, **accuracy: float) -> Outcome:
    """Every audible mode of a solid as any caller gets it; `accuracy` as `modes_of_solid` takes it."""
    watch = Stopwatch()
    with watch.step("solving"):
        product = modes_of_solid(
            surface,
            solid,
            material,
            max_frequency_hz=MAX_FREQUENCY_HZ,
            max_modes=MAX_MODES,
            training_points=1000,
            held_out_points=100,
            seed=0,
            **accuracy,
        )
    attributes = product.attributes
    return Outcome(
        np.sqrt(product["eigenvalues"]) / (2 * np.pi),
        int(attributes["discretisation"]["unknowns"]),
        watch.cpu_s,
        {
            "error_estimate_cents": attributes["error_estimate_cents"],
            "geometry_error_estimate_cents": attributes["geometry_error_estimate_cents"],
            "certificate_holds": attributes["count_certificate"]["holds"],
            "elements": len(solid.tetrahedra),
        },
    )


def tetwild(surface: Surface) -> Solid:
    """The mesh that pytetwild makes as it comes: edges 1/20 and an envelope of 1/1000 of the diagonal."""
    with tempfile.TemporaryDirectory() as folder:  # it leaves files where it runs
        np.savez(Path(folder) / "in.npz", vertices=surface.vertices, faces=surface.faces.astype(np.int32))
        subprocess.run([sys.executable, "-c", TETWILD], cwd=folder, check=True, capture_output=True)
        with np.load(Path(folder) / "out.npz") as made:
            return clean(made["vertices"], made["tetrahedra"].astype(np.int64), {})


class Ways:
    """Every way of solving a case; the two meshes are made once, their seconds added to all that use them."""

    def __init__(self, case: Case) -> None:
        self._case = case
        filled = partial(fill, case.surface, waves=audible_waves(case.material), name=case.name)
        self.our_mesh = cache(partial(self._mesh, filled))
        self.tetwild_mesh = cache(partial(self._mesh, partial(tetwild, case.surface)))

    def parts(self) -> Iterator[tuple[str, Callable[[], Outcome]]]:
        """Ours, ours with a part switched off, and plain elements."""
        case = self._case
        solve = partial(ours, surface=case.surface, material=case.material)
        yield OURS, partial(self._on, self.our_mesh, solve)
        straight = partial(self._straight, solve)
        yield "ours, straight elements", partial(self._on, self.our_mesh, straight)
        for order in (3, 4):
            everywhere = partial(of_order, material=case.material, order=order, bend=True)
            yield f"ours, order {order} everywhere", partial(self._on, self.our_mesh, everywhere)
        for order in (2, 3):
            plain = partial(of_order, material=case.material, order=order)
            if unknowns(self.tetwild_mesh()[0], order) <= MOST_UNKNOWNS:
                yield f"P{order}, pytetwild's mesh", partial(self._on, self.tetwild_mesh, plain)

    def rivals(self, ngsolve_python: str | None) -> Iterator[tuple[str, Callable[[], Outcome]]]:
        """Ours at other accuracies, the papers' cubes, other programs, another eigensolver."""
        surface, material = self._case.surface, self._case.material
        for cents in ACCURACIES:
            solve = partial(ours, surface=surface, material=material, accuracy_cents=cents)
            yield f"ours, {cents:g} cents", partial(self._on, self.our_mesh, solve)
        for resolution in RESOLUTIONS:
            for rule in ("touch", "centre"):
                yield f"voxel {resolution}^3 {rule}", partial(of_voxels, self._case, resolution, rule)
        if calculix.available():
            by_program = partial(calculix.calculix, material=material, modes=FIRST_MODES)
            yield "CalculiX P2, pytetwild's mesh", partial(self._on, self.tetwild_mesh, by_program)
        if ngsolve_python and ngsolve_solver.available(ngsolve_python):
            for order in (2, 3):
                by_program = partial(
                    ngsolve_solver.ngsolve, ngsolve_python, material=material, order=order, modes=FIRST_MODES
                )
                name = f"NGSolve P{order}, pytetwild's mesh"
                yield name, partial(self._on, self.tetwild_mesh, by_program)
        for preconditioner in lobpcg.PRECONDITIONERS:
            on_cubes = partial(lobpcg.on_voxels, surface, material, 32, preconditioner)
            yield f"LOBPCG, {preconditioner}, voxel 32^3", on_cubes

    @staticmethod
    def _mesh(make: Callable[[], Solid]) -> tuple[Solid, float]:
        watch = Stopwatch()
        with watch.step("meshing"):
            solid = make()
        return solid, watch.cpu_s["meshing"]

    @staticmethod
    def _straight(solve: Callable[[Solid], Outcome], solid: Solid) -> Outcome:
        """Solve on elements that know of no surface to follow."""
        return solve(replace(solid, target=None))

    @staticmethod
    def _on(mesh: Callable[[], tuple[Solid, float]], solve: Callable[[Solid], Outcome]) -> Outcome:
        solid, seconds = mesh()
        outcome = solve(solid)
        outcome.cpu_s = {"meshing": seconds, **outcome.cpu_s}
        return outcome


def unknowns(solid: Solid, order: int) -> int:
    """Size of the eigenproblem on tetrahedra of an order."""
    return 3 * Space.on(solid.vertices, solid.tetrahedra, order).size


def of_voxels(case: Case, resolution: int, rule: str) -> Outcome:
    """The papers' way."""
    modes = voxel_modes(
        case.surface, case.material, resolution=resolution, rule=rule, max_frequency_hz=MAX_FREQUENCY_HZ
    )
    seconds = dict(modes.cpu_s)
    seconds["meshing"] = seconds.pop("voxelise")
    notes = {"bodies": modes.components, "mass_ratio": modes.mass_ratio, "elements": modes.cells}
    return Outcome(np.sqrt(modes.eigenvalues) / (2 * np.pi), modes.unknowns, seconds, notes)


def duel_with_calculix(solid: Solid, material: Material) -> dict[str, Any]:
    """The first modes of one P2 mesh by CalculiX and by our solver: the same matrices but for CalculiX's
    mass, which it integrates by a rule that is not exact; the two agree as the mesh is fine."""
    own = of_order(solid, material, 2, FIRST_MODES)
    theirs = calculix.calculix(solid, material, FIRST_MODES)
    count = min(len(own.frequencies_hz), len(theirs.frequencies_hz), FIRST_MODES)
    apart = np.abs(theirs.frequencies_hz[:count] / own.frequencies_hz[:count] - 1)
    return {
        "modes": count,
        "unknowns": own.unknowns,
        "ours_cpu_s": own.cpu_s,
        "calculix_cpu_s": theirs.cpu_s,
        "times_faster": theirs.total_cpu_s / own.total_cpu_s,
        "largest_relative_difference": float(apart.max()),
    }


def measure(case: Case, ngsolve_python: str | None) -> dict[str, Any]:
    """All ways on one case."""
    ways = Ways(case)
    result: dict[str, Any] = {
        "material": case.material.name,
        "faces": len(case.surface.faces),
        "reference": case.reference,
        "ways": {},
    }
    compared = list(ways.parts())
    if case.name == RIVAL_BODY:
        compared += ways.rivals(ngsolve_python)
    for name, run in compared:
        outcome = run()
        found = {
            **compare(outcome.frequencies_hz, case.reference_hz),
            "unknowns": outcome.unknowns,
            "cpu_s": outcome.cpu_s,
            "total_cpu_s": outcome.total_cpu_s,
            **outcome.notes,
        }
        result["ways"][name] = found
        shown = ("modes", "modes_of_reference", "median_cents", "worst_cents", "unknowns", "total_cpu_s")
        print(case.name, name, {key: found.get(key) for key in shown}, flush=True)
    if case.name == RIVAL_BODY:
        if calculix.available():
            result["duel_with_calculix"] = duel_with_calculix(ways.tetwild_mesh()[0], case.material)
        own, papers = result["ways"][OURS], result["ways"]["voxel 32^3 touch"]
        result["against_voxels"] = {
            "times_better": papers["median_cents"] / own["median_cents"],
            "times_slower": own["total_cpu_s"] / papers["total_cpu_s"],
        }
    return result


def draw(figures: dict[str, Any]) -> None:
    """Median error over seconds of every way on the bowl, and of ours and its parts on all bodies."""
    figure, (by_time, by_body) = subplots(1, 2, figsize=(15, 6))
    for pattern, style, colour in FAMILIES:
        rows = sorted(
            (way["total_cpu_s"], way["median_cents"], name)
            for name, way in figures[RIVAL_BODY]["ways"].items()
            if re.match(pattern, name) and way.get("median_cents")
        )
        if not rows:
            continue
        label = pattern.replace(r"(, \d+ cents)?$", "").replace(" .*", "").replace("P.", "P2, P3")
        seconds, cents, names = zip(*rows, strict=True)
        by_time.plot(seconds, cents, style, color=colour, label=label, ms=6, lw=1)
        for x, y, name in zip(seconds, cents, names, strict=True):
            short = re.sub(r"^(ours|voxel|CalculiX|NGSolve|LOBPCG),? ?", "", name).split(",")[0]
            by_time.annotate(short, (x, y), fontsize=7, xytext=(4, 4), textcoords="offset points")
    by_time.set(xscale="log", xlabel="CPU seconds, meshing included", title=RIVAL_BODY)
    parts = [name for name in figures[RIVAL_BODY]["ways"] if re.match("ours$|ours, [so]|P", name)]
    for row, name in enumerate(parts):
        found = [body["ways"].get(name, {}).get("median_cents") for body in figures.values()]
        places = np.arange(len(found)) + 0.12 * (row - len(parts) / 2)
        by_body.plot(places, [np.nan if cents is None else cents for cents in found], "o", label=name)
    by_body.set_xticks(range(len(figures)), list(figures))
    by_body.set_title("what each part brings")
    for axes in (by_time, by_body):
        axes.set(yscale="log", ylabel="median frequency error, cents")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    save(figure, "discretisation")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="where rows are kept")
    parser.add_argument("--scans", type=Path, default=FOLDER, help="folder of scans with catalogue.csv")
    parser.add_argument(
        "--bodies", nargs="*", default=list(BODIES), help="of revolution", choices=list(BODIES)
    )
    parser.add_argument("--objects", nargs="*", default=SCANS, help="scans to compare on")
    parser.add_argument(
        "--ngsolve-python", default=os.environ.get("NGSOLVE_PYTHON"), help=f"e.g. {ngsolve_solver.HOW}"
    )
    options = parser.parse_args()
    absent = []
    if not calculix.available():
        absent.append(f"CalculiX ({calculix.HOW})")
    if not ngsolve_solver.available(options.ngsolve_python):
        absent.append(f"NGSolve ({ngsolve_solver.HOW})")
    print(f"left out, as it is absent: {', '.join(absent) or 'nothing'}", flush=True)
    settings = {
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "threads": os.environ.get("OMP_NUM_THREADS"),
        "first_modes_of_rivals": FIRST_MODES,
        "most_unknowns": MOST_UNKNOWNS,
        "lobpcg_modes": lobpcg.MODES,
        "finest": {"accuracy_cents": FINEST_CENTS, **FINEST_FILLING},
        "left_out": absent,
    }
    figures = {
        name: kept(
            options.folder / f"{name}.json",
            lambda at=name: measure(case_of(at, options.scans), options.ngsolve_python),
        )
        for name in (*options.bodies, *options.objects)
    }
    conclude("discretisation", figures, settings, COMPARED, draw)


if __name__ == "__main__":
    main()
