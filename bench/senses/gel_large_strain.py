"""What large strains change of a gel under a ball, by finite elements that share nothing with the solver.

    python -m bench.senses.gel_large_strain

CalculiX (``ccx``, Debian's package ``calculix-ccx``) presses a rigid ball without friction into a
neo-Hookean disc that is bonded to a rigid back, axisymmetric and with large strains and displacements; the
linear layer of `solve_contact` is pressed with the same constants. One ball and pad are those of the
measured GelSight Mini; the other ball is that of the marker pictures.
"""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from bench.record import arguments, conclude, cpu_seconds
from objectfolder.touch import Elastomer, solve_contact
from objectfolder.touch.elastic.tangential_influence import tangential_compliance

MODULUS_PA, POISSON_RATIO, THICKNESS_M = 5.48e5, 0.45, 0.004
STEP_MM = 0.5
# Radius of ball and pad, depth, and of the disc: its radius, that of its fine part, and a fine element.
CASES = {
    "ball of 15 mm on a Mini's pad": (7.5, 183.8, 2.0, 11.4, 6.0, 0.3),
    "ball of 4.7 mm on a flat pad": (2.35, 1e6, 1.0, 9.0, 3.0, 0.25),
}
ROWS, BALL_ELEMENTS, BALL_DEG = 8, 80, 75.0
FORCES_OF_SECTOR = 180  # CalculiX prints those of a sector of two degrees
CELLS = 160
COMPARED = "force and sideways displacement of linear elasticity against finite elements of large strain"


def disc(pad: float, radius: float, fine_to: float, fine: float) -> tuple[list[str], np.ndarray]:
    """Lines of the gel's nodes, elements and sets, millimetres; radii of the nodes on top."""
    inner = np.arange(0.0, fine_to + fine / 2, fine)
    corner = np.concatenate([inner, np.geomspace(inner[-1], radius, 11)[1:]])
    across = np.interp(np.arange(2 * len(corner) - 1) / 2, np.arange(len(corner)), corner)
    number: dict[tuple[int, int], int] = {}
    nodes, elements, top = ["*NODE,NSET=GEL"], ["*ELEMENT,TYPE=CAX8R,ELSET=GEL"], ["*SURFACE,NAME=TOP"]
    for i, r in enumerate(across):
        for j in range(2 * ROWS + 1):
            if i % 2 == 0 or j % 2 == 0:
                number[i, j] = len(number) + 1
                height = j / (2 * ROWS) * (1e3 * THICKNESS_M - r * r / (2 * pad))
                nodes.append(f"{number[i, j]},{r:.9g},{height:.9g}")
    around = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    for i in range(0, len(across) - 1, 2):
        for j in range(0, 2 * ROWS, 2):
            corners = ",".join(str(number[i + a, j + b]) for a, b in around)
            elements.append(f"{len(elements)},{corners}")
        top.append(f"{len(elements) - 1},S3")
    sets = []
    for name, chosen in {
        "BASE": [number[i, 0] for i in range(len(across))],
        "AXIS": [number[0, j] for j in range(2 * ROWS + 1)],
        "SURFACE": [number[i, 2 * ROWS] for i in range(len(across))],
    }.items():
        sets += [f"*NSET,NSET={name}", *map(str, chosen)]
    return [*nodes, *elements, *sets, *top], across


def rigid_ball(radius: float) -> list[str]:
    """Lines of a ball's skin just above the gel, all of whose nodes are led."""
    number: dict[tuple[int, int], int] = {}
    nodes, elements = ["*NODE,NSET=BALL"], ["*ELEMENT,TYPE=CAX8R,ELSET=BALL"]
    surface = ["*SURFACE,NAME=SKIN"]
    for i, angle in enumerate(np.radians(np.linspace(0, BALL_DEG, 2 * BALL_ELEMENTS + 1))):
        for j in range(3):
            if i % 2 == 0 or j != 1:
                number[i, j] = 100_001 + len(number)
                r = radius * (0.9 + 0.05 * j)
                height = 1e3 * THICKNESS_M + radius + 1e-4 - r * np.cos(angle)
                nodes.append(f"{number[i, j]},{r * np.sin(angle):.9g},{height:.9g}")
    around = [(0, 2), (2, 2), (2, 0), (0, 0), (1, 2), (2, 1), (1, 0), (0, 1)]
    for i in range(0, 2 * BALL_ELEMENTS, 2):
        name = 100_000 + len(elements)
        elements.append(f"{name}," + ",".join(str(number[i + a, b]) for a, b in around))
        surface.append(f"{name},S1")
    return [*nodes, *elements, *surface]


def deck(gel: list[str], ball: list[str], depth: float) -> str:
    """Return CalculiX's input, in millimetres, newtons and megapascals."""
    modulus = 1e-6 * MODULUS_PA
    shear, bulk = modulus / (2 * (1 + POISSON_RATIO)), modulus / (3 * (1 - 2 * POISSON_RATIO))
    lines = [
        *("*HEADING", "a ball on a gel", *gel, *ball),
        *("*MATERIAL,NAME=SILICONE", "*HYPERELASTIC,NEO HOOKE", f"{shear / 2},{2 / bulk}"),
        *("*MATERIAL,NAME=STEEL", "*ELASTIC", "2e5,0.3"),
        *("*SOLID SECTION,ELSET=GEL,MATERIAL=SILICONE", "*SOLID SECTION,ELSET=BALL,MATERIAL=STEEL"),
        *("*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE", "TOP,SKIN"),
        *("*SURFACE INTERACTION,NAME=TOUCH", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR"),
        *(f"{100 * modulus},0.0", "*BOUNDARY", "BASE,1,2", "AXIS,1,1", "BALL,1,1"),
    ]
    for step in range(1, round(depth / STEP_MM) + 1):
        lines += [
            *("*STEP,INC=1000,NLGEOM", "*STATIC", "0.1,1.,1e-4,0.25"),
            *("*BOUNDARY", f"BALL,2,2,{-STEP_MM * step - 1e-4}"),
            *("*NODE PRINT,NSET=BALL,TOTALS=ONLY,FREQUENCY=1000", "RF"),
            *("*NODE PRINT,NSET=SURFACE,FREQUENCY=1000", "U", "*END STEP"),
        ]
    return "\n".join(lines) + "\n"


def finite_elements(case: tuple[float, ...]) -> tuple[list[float], list[np.ndarray], np.ndarray]:
    """Forces, newtons, outward displacements, mm, of the surface by depth, and its nodes' radii, mm."""
    radius, pad, depth, *size = case
    gel, across = disc(pad, *size)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "gel.inp").write_text(deck(gel, rigid_ball(radius), depth), encoding="utf-8")
        # Where an increment does not converge it ends early: the steps before are there.
        subprocess.run(["ccx", "gel"], cwd=folder, capture_output=True, check=False)
        words = [line.split() for line in (Path(folder) / "gel.dat").read_text(encoding="utf-8").splitlines()]
    forces = [
        abs(FORCES_OF_SECTOR * float(words[i + 2][1]))
        for i, line in enumerate(words)
        if line[:2] == ["total", "force"]
    ]
    starts = [i + 2 for i, line in enumerate(words) if line[:1] == ["displacements"]]
    outward = [np.array([float(words[i + k][1]) for k in range(len(across))]) for i in starts]
    return forces, outward, across


def linear(case: tuple[float, ...], depth: float, at: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Force, newtons, contact radius and outward displacement at radii `at`, mm, of the linear layer."""
    radius, pad, width = case[0] * 1e-3, case[1] * 1e-3, 2e-3 * case[4]
    pitch = width / CELLS
    x = (np.arange(CELLS) - (CELLS - 1) / 2) * pitch
    square = x[:, None] ** 2 + x**2
    ball = radius - np.sqrt(np.maximum(radius**2 - square, 0.0))
    gap = np.where(square < radius**2, ball, np.inf) + square / (2 * pad)
    gel = Elastomer(MODULUS_PA, POISSON_RATIO, THICKNESS_M)
    contact = solve_contact(gap, pitch, gel, indentation_m=depth * 1e-3)
    sideways = tangential_compliance(gel, gap.shape, contact.pitch_m).displacement_by_pressure(
        contact.pressure_pa
    )
    along = sideways[1, CELLS // 2, CELLS // 2 :] * 1e3
    touched = 1e3 * float(np.sqrt(contact.contact_area_m2 / np.pi))
    return contact.force_n, touched, np.interp(at, x[CELLS // 2 :] * 1e3, along)


def main() -> None:
    """Press both balls by both methods."""
    arguments(__doc__).parse_args()
    if shutil.which("ccx") is None:
        raise SystemExit("ccx is not there: install CalculiX (Debian: apt-get install calculix-ccx)")
    start, cases = cpu_seconds(), {}
    for name, case in CASES.items():
        forces, outward, across = finite_elements(case)
        inside = across < case[4]
        cases[name] = []
        for step, (force, moved) in enumerate(zip(forces, outward, strict=True), 1):
            newtons, touched, sideways = linear(case, step * STEP_MM, across[inside])
            row = {
                "depth_mm": step * STEP_MM,
                "large_strain_n": force,
                "linear_n": newtons,
                "contact_radius_mm": touched,
                "radius_mm": across[inside],
                "large_strain_outward_mm": moved[inside],
                "linear_outward_mm": sideways,
            }
            cases[name].append(row)
            print(name, {key: row[key] for key in list(row)[:4]}, flush=True)
    settings = {
        "youngs_modulus_pa": MODULUS_PA,
        "poisson_ratio": POISSON_RATIO,
        "thickness_m": THICKNESS_M,
        "friction": 0,
        "rows_of_elements": ROWS,
        "cpu_s": cpu_seconds() - start,
    }
    conclude("gel_large_strain", {"cases": cases}, settings, COMPARED)


if __name__ == "__main__":
    main()
