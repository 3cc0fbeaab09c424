"""Where the energy of strikers goes on all objects of the starter set, and whether modes get their share.

    python -m bench contact_energy --folder FOLDER [--only NAME ...]

Each striker hits each object at random points, along the normal. Modes are solved to 20 kHz and damped by
their material. At some points their energy is compared with a Runge-Kutta integration of the coupled bodies.
Rows are kept in FOLDER and not measured again.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.record import arguments, conclude, measure_once
from bench.senses.air import starter_set
from objectfolder.audio.synthesis.collision import Collider, collide
from objectfolder.audio.synthesis.hertz import STRIKERS, ContactBody
from objectfolder.audio.synthesis.sources import Motion, along
from objectfolder.audio.synthesis.struck_body import RigidBody, StruckBody
from objectfolder.making.damping import damping_of
from objectfolder.surface.integrals import solid_properties
from tests.references.coupled_contact import coupled_contact
from tests.references.free_modes import FreeModes

Floats = NDArray[np.float64]
COMPARED = (
    "energy left in striker, modes and object as a whole over that of the striker before, over all points; "
    "energy of the modes with a Runge-Kutta integration of the coupled bodies of order 8, relative, where "
    "modes have a thousandth of the striker's energy at least"
)
OBJECTS = ("mug", "bowl", "bell", "plate", "fork", "spatula", "die")
SPEED_M_S, POINTS, REFERENCE_POINTS = 1.0, 100, 5
LEAST_SHARE = 1e-3


def measure(folder: Path, name: str) -> dict[str, Any]:
    """Energies of all contacts of an object, by striker."""
    surface, material = starter_set(folder).body(name)
    modes = FreeModes.of(surface, material)
    outside, density = modes.boundary.surface, material.density_kg_m3
    places = outside.sample(POINTS, 0)
    vectors = modes.vectors / np.sqrt(density * modes.length_m**3)
    motion = Motion(modes.boundary.at(vectors, places.face, places.barycentric), lambda: places.normals)
    solid = solid_properties(outside.vertices, outside.faces)
    inertia = density * solid.inertia_per_density_m5
    rigid = RigidBody(density * solid.volume_m3, solid.centre_of_mass_m, inertia, float(outside.area))
    eigenvalues = (2 * np.pi * modes.frequencies_hz) ** 2
    body = StruckBody(
        eigenvalues,
        damping_of(material).decay_rates(eigenvalues),
        np.ones(len(eigenvalues)),
        lambda _: motion.shapes,
        lambda _: places.normals,
        rigid,
        (material.youngs_modulus_pa, material.poisson_ratio),
    )
    rows = {name: struck(body, places.points, motion, striker) for name, striker in STRIKERS.items()}
    return {"modes": len(eigenvalues), **rows}


def struck(body: StruckBody, points: Floats, motion: Motion, striker: ContactBody) -> dict[str, Any]:
    """Energies that a striker leaves, and the differences of the modes' from the integration."""
    directions = -motion.normals()
    impulses = body.passed_on(points, SPEED_M_S * directions, striker)
    energy = body.collisions(points, motion, impulses, striker).energy_j
    off = []
    for row in range(REFERENCE_POINTS):
        if energy.vibration[row] > LEAST_SHARE * energy.striker[row]:
            contact = body.contact(striker, points[row], directions[row])
            collider = Collider(body.modes, along(directions[row : row + 1], motion.shapes[row : row + 1])[0])
            end_s = collide([collider], contact, SPEED_M_S, striker.restitution).profile.duration_s
            _, true = coupled_contact([collider], contact, SPEED_M_S, striker.restitution, end_s)
            off.append(abs(float(energy.vibration[row] / true[0]) - 1))
    remaining_share = (energy.rebound + energy.vibration + energy.motion) / energy.striker
    return {
        "left_least": float(remaining_share.min()),
        "left_most": float(remaining_share.max()),
        "modal_share_median": float(np.median(energy.vibration / energy.striker)),
        "modal_share_off": off,
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="where rows are kept")
    parser.add_argument("--only", nargs="+", default=OBJECTS, choices=OBJECTS)
    options = parser.parse_args()
    rows = {}
    for name in options.only:
        rows[name] = measure_once(
            options.folder / f"contact_{name}.json", partial(measure, options.folder, name)
        )
        print(name, rows[name], flush=True)
    contacts = [row[striker] for row in rows.values() for striker in STRIKERS]
    off = [value for contact in contacts for value in contact["modal_share_off"]]
    figures = {
        "objects": rows,
        "contacts": POINTS * len(contacts),
        "left_least": min(contact["left_least"] for contact in contacts),
        "left_most": max(contact["left_most"] for contact in contacts),
        "modal_share_compared": len(off),
        "modal_share_off_at_most": max(off, default=None),
    }
    settings = {"speed_m_s": SPEED_M_S, "points": POINTS, "reference_points": REFERENCE_POINTS}
    conclude("contact_energy", figures, settings, COMPARED)


if __name__ == "__main__":
    main()
