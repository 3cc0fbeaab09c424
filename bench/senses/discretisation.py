"""Speed against error of ways to find the modes of a bowl: ours, the papers' voxels, and CalculiX.

    python -m bench discretisation --folder FOLDER

Every way starts from the same triangles of a body of revolution. The reference is an axisymmetric solution of
the true body (`tests.references`), which shares no code with the solver. Errors are of undamped frequencies
below 20 kHz, matched in ascending order. Seconds are CPU seconds of the whole way, meshing included. CalculiX
is left out where it is not installed.
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import Stopwatch, arguments, conclude, rows_of, save, subplots
from bench.rivals.audio import calculix
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, MAX_MODES, Outcome, compare
from bench.rivals.audio.voxels import voxel_modes
from bench.senses.catalogue import MATERIALS
from objectfolder.making.elements.elasticity import ElementMatrices
from objectfolder.making.materials import Material, read_materials
from objectfolder.making.modes.eigen import count_below, lowest_elastic
from objectfolder.making.modes.modes import modes_of_solid, waves_of
from objectfolder.making.modes.spectrum import pencil_of, space_on
from objectfolder.making.solid.filling import fill
from objectfolder.making.solid.solid import Solid, clean
from objectfolder.surface.surface import Surface
from tests.references.bodies import BODIES

BODY = "bowl"
# Cents asked for beside the default.
ACCURACIES = (1.0, 2.0, 10.0, 20.0)
RESOLUTIONS, RULES = (16, 32, 64), ("touch", "centre")
FIRST_MODES = 50
OURS = "ours"
TETWILD = """
import numpy, pytetwild
given = numpy.load("in.npz")
vertices, tetrahedra = pytetwild.tetrahedralize(given["vertices"], given["faces"], num_threads=1, quiet=True)
numpy.savez("out.npz", vertices=vertices, tetrahedra=tetrahedra)
"""
COMPARED = (
    "undamped frequencies below the limit in ascending order against the reference, cents; CPU seconds by "
    "step, children included; CalculiX was asked for its first modes only"
)
FAMILIES = (
    (r"ours(, \d+ cents)?$", "o-", "C3"),
    ("P., pytetwild", "v-", "C0"),
    ("voxel .* touch", "s-", "C9"),
    ("voxel .* centre", "s--", "C8"),
    ("CalculiX", "D", "C4"),
)


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
        with np.load(Path(folder) / "out.npz") as arrays:
            return clean(arrays["vertices"], arrays["tetrahedra"].astype(np.int64), {})


def meshed(make: Callable[[], Solid]) -> Callable[[], tuple[Solid, float]]:
    """Return what makes a mesh once, and gives it with its CPU seconds to every way that uses it."""

    @cache
    def mesh() -> tuple[Solid, float]:
        watch = Stopwatch()
        with watch.step("meshing"):
            solid = make()
        return solid, watch.cpu_s["meshing"]

    return mesh


def on(mesh: Callable[[], tuple[Solid, float]], solve: Callable[[Solid], Outcome]) -> Outcome:
    """Solve on a mesh, whose seconds count."""
    solid, seconds = mesh()
    outcome = solve(solid)
    outcome.cpu_s = {"meshing": seconds, **outcome.cpu_s}
    return outcome


def of_voxels(surface: Surface, material: Material, resolution: int, rule: str) -> Outcome:
    """The papers' way."""
    modes = voxel_modes(
        surface, material, resolution=resolution, rule=rule, max_frequency_hz=MAX_FREQUENCY_HZ
    )
    seconds = dict(modes.cpu_s)
    seconds["meshing"] = seconds.pop("voxelise")
    notes = {"bodies": modes.components, "mass_ratio": modes.mass_ratio, "elements": modes.cells}
    return Outcome(np.sqrt(modes.eigenvalues) / (2 * np.pi), modes.unknowns, seconds, notes)


def quadratic(solid: Solid, material: Material) -> Outcome:
    """The first modes in all functions of order 2 on straight elements, counted."""
    watch = Stopwatch()
    length = float(np.ptp(solid.vertices, axis=0).max())
    radians = material.shear_speed_m_s / length
    audible = (2 * np.pi * MAX_FREQUENCY_HZ / radians) ** 2
    with watch.step("assembly"):
        space, _ = space_on(solid, 2, length, bend=False)
        every = np.ones(space.size, dtype=bool)
        pencil = pencil_of(ElementMatrices(space, material.poisson_ratio), solid.component, every)
    with watch.step("factorisation and eigenvectors"):
        values = lowest_elastic(
            pencil, below=np.inf, at_most=FIRST_MODES, shift=-min(0.05, audible / 4), tolerance=1e-7
        ).values
    with watch.step("certificate"):
        counted = count_below(pencil, (values[FIRST_MODES - 1] + values[FIRST_MODES]) / 2)
    hertz = np.sqrt(values[:FIRST_MODES]) * radians / (2 * np.pi)
    notes = {"elements": len(solid.tetrahedra), "certificate_holds": counted == FIRST_MODES}
    return Outcome(hertz, pencil.size, watch.cpu_s, notes)


def duel_with_calculix(solid: Solid, material: Material) -> dict[str, Any]:
    """The first modes of one P2 mesh by CalculiX and by our solver: the same matrices but for CalculiX's
    mass, which it integrates by a rule that is not exact; the two agree as the mesh is fine."""
    own = quadratic(solid, material)
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


def measure(name: str) -> dict[str, Any]:
    """All ways on one body."""
    body, watch = BODIES[name](), Stopwatch()
    material, surface = read_materials(MATERIALS)[body.material], body.surface()
    with watch.step("reference"):
        truth = body.spectrum(material, MAX_FREQUENCY_HZ)
    reference_hz = truth.frequencies_hz(material)
    filled = meshed(partial(fill, surface, waves=waves_of(material, MAX_FREQUENCY_HZ, MAX_MODES), name=name))
    plain = meshed(partial(tetwild, surface))

    def ways() -> Iterator[tuple[str, Callable[[], Outcome]]]:
        yield OURS, partial(on, filled, partial(ours, surface=surface, material=material))
        for cents in ACCURACIES:
            solve = partial(ours, surface=surface, material=material, accuracy_cents=cents)
            yield f"ours, {cents:g} cents", partial(on, filled, solve)
        for resolution in RESOLUTIONS:
            for rule in RULES:
                yield f"voxel {resolution}^3 {rule}", partial(of_voxels, surface, material, resolution, rule)
        if calculix.available():
            solve = partial(calculix.calculix, material=material, modes=FIRST_MODES)
            yield "CalculiX P2, pytetwild's mesh", partial(on, plain, solve)

    rows = {}
    for way, run in ways():
        outcome = run()
        rows[way] = {
            **compare(outcome.frequencies_hz, reference_hz),
            "unknowns": outcome.unknowns,
            "cpu_s": outcome.cpu_s,
            "total_cpu_s": outcome.total_cpu_s,
            **outcome.notes,
        }
        print(way, {key: rows[way].get(key) for key in ("modes", "median_cents", "total_cpu_s")}, flush=True)
    own, papers = rows[OURS], rows["voxel 32^3 touch"]
    return {
        "material": material.name,
        "faces": len(surface.faces),
        "reference": {"convergence": truth.convergence, "cpu_s": watch.cpu_s["reference"]},
        "ways": rows,
        "duel_with_calculix": duel_with_calculix(plain()[0], material) if calculix.available() else None,
        "against_voxels": {
            "times_better": papers["median_cents"] / own["median_cents"],
            "times_slower": own["total_cpu_s"] / papers["total_cpu_s"],
        },
    }


def draw(figures: dict[str, Any]) -> None:
    """Median error over seconds of every way on the bowl."""
    figure, axes = subplots(figsize=(8, 6))
    for pattern, style, colour in FAMILIES:
        rows = sorted(
            (way["total_cpu_s"], way["median_cents"], name)
            for name, way in figures[BODY]["ways"].items()
            if re.match(pattern, name) and way.get("median_cents")
        )
        if not rows:
            continue
        label = pattern.replace(r"(, \d+ cents)?$", "").replace(" .*", "").replace("P.", "P2, P3")
        seconds, cents, names = zip(*rows, strict=True)
        axes.plot(seconds, cents, style, color=colour, label=label, ms=6, lw=1)
        for x, y, name in zip(seconds, cents, names, strict=True):
            short = re.sub(r"^(ours|voxel|CalculiX),? ?", "", name).split(",")[0]
            axes.annotate(short, (x, y), fontsize=7, xytext=(4, 4), textcoords="offset points")
    axes.set(xscale="log", xlabel="CPU seconds, meshing included", title=BODY)
    axes.set(yscale="log", ylabel="median frequency error, cents")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
    save(figure, "discretisation")


def main() -> None:
    """Measure the bowl."""
    folder = arguments(__doc__, keeps="rows").parse_args().folder
    if not calculix.available():
        print(f"left out: CalculiX ({calculix.HOW})", flush=True)
    settings = {
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "first_modes_of_rivals": FIRST_MODES,
        "left_out": [] if calculix.available() else ["CalculiX"],
    }
    conclude("discretisation", rows_of([BODY], measure, folder), settings, COMPARED, draw)
