"""Errors of frequencies as stated, against the true ones, of bodies held out when the statement was chosen.

    python -m bench stated_errors --folder FOLDER [--only NAME ...]

Bodies of revolution and cuboids, as triangles, solved at the default settings. A mode's stated error is its
estimate plus that of the geometry; its true one is against an independent reference (`tests.references`),
modes matched in ascending order. Rows are kept in FOLDER and not measured again, so that a run that was cut
off goes on. The numbers of the statement were chosen on `FITTED`.
"""

from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from bench.record import arguments, conclude, cpu_seconds, rows_of
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, MAX_MODES, compare
from bench.senses.catalogue import MATERIALS
from objectfolder.making.materials import Material, read_materials
from objectfolder.making.modes.modes import ACCURACY_CENTS, SPHERE, simulate_modes
from objectfolder.surface.surface import Surface
from tests.references import bodies, held_out, thin_walls
from tests.references.cuboid import cuboid
from tests.references.held_out import CUBOIDS
from tests.references.spectrum import wavenumber_limit

COMPARED = (
    "stated errors (estimate of the mode plus that of the geometry) with true ones, cents, of undamped "
    "frequencies below the limit in ascending order, at default settings; fitted: bodies that had part in "
    "choosing the numbers of the estimate; held out: the others"
)
BODIES = {**bodies.BODIES, **held_out.BODIES, **thin_walls.BODIES}
FITTED = (
    "bowl", "glass", "bell", "cup", "plate", "tulip", "beaker", "swan", "dish", "gong", "pan",
    "chime", "tile", "brick",
)  # fmt: skip
TURN = Rotation.from_rotvec([0.3, 0.7, -0.4]).as_matrix()
FIRST_MODES = 50


def case_of(name: str) -> tuple[Surface, Material, np.ndarray]:
    """Triangles of a body, its material, and its undamped frequencies to a little above the limit, Hz."""
    materials, limit_hz = read_materials(MATERIALS), 1.05 * MAX_FREQUENCY_HZ
    if name in BODIES:
        body = BODIES[name]()
        material = materials[body.material]
        return body.surface(), material, body.spectrum(material, limit_hz).frequencies_hz(material)
    lengths, of, turned = CUBOIDS[name]
    material = materials[of]
    spectrum = cuboid(lengths, material.poisson_ratio, wavenumber_limit(material, limit_hz))
    box = trimesh.creation.box(lengths)
    vertices = np.array(box.vertices) @ (TURN.T if turned else np.eye(3))
    return Surface(vertices, np.array(box.faces)), material, spectrum.frequencies_hz(material)


def measure(name: str) -> dict[str, Any]:
    surface, material, reference_hz = case_of(name)
    start = cpu_seconds()
    product = simulate_modes(
        surface, material, name=name, max_frequency_hz=MAX_FREQUENCY_HZ, max_modes=MAX_MODES,
        training_points=1000, held_out_points=100, seed=0, radiation=SPHERE,
    )  # fmt: skip
    spent = cpu_seconds() - start
    geometry = product.attributes["geometry_error_estimate_cents"] or 0.0
    stated = product["error_estimates_cents"] + geometry
    comparison = compare(np.sqrt(product["eigenvalues"]) / (2 * np.pi), reference_hz)
    certificate = product.attributes["count_certificate"]
    return {
        "material": material.name,
        **comparison,
        "reached": product.attributes["accuracy_reached"],
        "stated_cents": np.round(stated[: comparison["compared"]], 3).tolist(),
        "near_limit": {key: value for key, value in certificate.items() if "within_error" in key},
        "unknowns": product.attributes["discretisation"]["unknowns"],
        "cpu_s": spent,
    }


def figures(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    fitted = {name: row for name, row in rows.items() if name in FITTED}
    held_out = {name: row for name, row in rows.items() if name not in FITTED}
    parts = {"fitted": fitted, "held_out": held_out}
    return {"bodies": rows, **{part: together(some) for part, some in parts.items() if some}}


def together(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    true = np.abs(np.concatenate([row["cents"] for row in rows.values()]))
    stated = np.concatenate([row["stated_cents"] for row in rows.values()])
    return {
        "modes": len(true),
        "covered": int(np.count_nonzero(stated >= true)),
        "median_stated_over_true": float(np.median(stated / np.maximum(true, 1e-3))),
        "worst_cents": float(true.max()),
        "worst_of_first_50_cents": max(
            float(np.abs(row["cents"][:FIRST_MODES]).max()) for row in rows.values()
        ),
        "within_the_wish": sum(np.abs(row["cents"]).max() <= ACCURACY_CENTS for row in rows.values()),
        "of_them_said_to_be": sum(
            row["reached"] for row in rows.values() if np.abs(row["cents"]).max() <= ACCURACY_CENTS
        ),
        "others_said_to_be": sum(
            row["reached"] for row in rows.values() if np.abs(row["cents"]).max() > ACCURACY_CENTS
        ),
        "counts_right": sum(row["modes"] == row["modes_of_reference"] for row in rows.values()),
        "median_cpu_s": float(np.median([row["cpu_s"] for row in rows.values()])),
    }


def main() -> None:
    options = arguments(__doc__, keeps="rows", only=[*BODIES, *CUBOIDS]).parse_args()
    rows = rows_of(options.only, measure, options.folder)
    settings = {"max_frequency_hz": MAX_FREQUENCY_HZ, "accuracy_cents": ACCURACY_CENTS, "radiation": SPHERE}
    conclude("stated_errors", figures(rows), settings, COMPARED)
