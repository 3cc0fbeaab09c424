"""Bodies of revolution with thin walls: this project's modes of their surfaces against an independent solver.

Run as ``python -m bench.senses.revolution``. The solver sees only a closed triangle surface; the reference
is an axisymmetric solution of the true body (`bench.references`), which shares no code with it.
"""

from typing import Any

import numpy as np

from bench.discretisation_ours import ours
from bench.discretisation_outcome import MAX_FREQUENCY_HZ, Stopwatch, compare
from bench.record import REPOSITORY, arguments, save, subplots, write
from bench.references.bodies import BODIES
from bench.references.spectrum import ReferenceSpectrum
from objectfolder.audio.materials import Material, read_materials

# Bars of the project: every audible mode within so many cents, at so many CPU seconds of solving.
CENTS, SOLVING_CPU_S = 5.0, 10.0


def measure(name: str, edge_m: float | None, accuracy: dict[str, Any]) -> dict[str, Any]:
    """One body: errors over all audible modes, whether the count is right, CPU seconds."""
    body = BODIES[name]()
    material = read_materials(REPOSITORY / "data" / "materials.csv")[body.material]
    watch = Stopwatch()
    with watch.step("reference"):
        truth = body.spectrum(material, MAX_FREQUENCY_HZ)
    surface = body.surface(edge_m)
    outcome = ours(surface, material, name, **accuracy)
    figures = {
        "material": body.material,
        "faces": len(surface.faces),
        **compare(outcome.frequencies_hz, truth.frequencies_hz(material)),
        "reference_mode_nearest_the_limit_cents": nearest_to_limit(truth, material),
        "distinct_modes_of_reference": len(truth.wavenumbers),
        "reference_convergence": truth.convergence,
        "cpu_s": outcome.cpu_s,
        "reference_cpu_s": watch.cpu_s["reference"],
        "unknowns": outcome.unknowns,
        **outcome.notes,
    }
    figures["count_right"] = figures["modes"] == figures["modes_of_reference"]
    figures["meets_bar"] = bool(
        figures["count_right"]
        and figures["worst_cents"] <= CENTS
        and outcome.cpu_s["solving"] <= SOLVING_CPU_S
    )
    shown = ("modes", "modes_of_reference", "median_cents", "worst_cents", "mean_cents", "unknowns", "cpu_s")
    print(name, {key: figures[key] for key in shown}, flush=True)
    return figures


def nearest_to_limit(truth: ReferenceSpectrum, material: Material) -> float:
    """How far below the limit the last audible mode lies: an error as large as that changes the count."""
    return float(1200 * np.log2(MAX_FREQUENCY_HZ / truth.frequencies_hz(material)[-1]))


def plot(figures: dict[str, Any]) -> None:
    """Error of every mode by its place in the spectrum."""
    figure, axes = subplots(figsize=(9, 6))
    for mark, (name, found) in zip("os^Dv", figures.items(), strict=False):
        share = (np.arange(len(found["cents"])) + 0.5) / len(found["cents"])
        label = f"{name}: {found['modes']} of {found['modes_of_reference']} modes, "
        label += f"{found['cpu_s']['solving']:.1f} CPU-s of solving"
        axes.plot(share, found["cents"], mark, ms=4, label=label)
    axes.axhspan(-CENTS, CENTS, color="0.9", zorder=0)
    axes.set_yscale("symlog", linthresh=CENTS)
    axes.set_xlabel("place among the audible modes")
    axes.set_ylabel("frequency error, cents")
    axes.legend(fontsize=9, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncol=2)
    save(figure, "revolution")


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--bodies", nargs="+", default=list(BODIES), choices=list(BODIES))
    parser.add_argument(
        "--edge-m", type=float, help="edge of the surface's triangles, by default each body's"
    )
    parser.add_argument("--accuracy-cents", type=float, help="asked of the solver, by default its own")
    options = parser.parse_args()
    accuracy = {} if options.accuracy_cents is None else {"accuracy_cents": options.accuracy_cents}
    figures = {name: measure(name, options.edge_m, accuracy) for name in options.bodies}
    settings = {
        "max_frequency_hz": MAX_FREQUENCY_HZ,
        "edge_m": options.edge_m or {name: BODIES[name]().edge_m for name in options.bodies},
        "accuracy": accuracy or "default",
        "bar_cents": CENTS,
        "bar_solving_cpu_s": SOLVING_CPU_S,
    }
    write(
        "revolution",
        figures,
        settings,
        "undamped eigenfrequencies of a filled triangle surface against an axisymmetric Fourier p-FEM of the "
        "true body, all modes below the limit, matched in ascending order; CPU seconds, children included",
    )
    plot(figures)


if __name__ == "__main__":
    main()
