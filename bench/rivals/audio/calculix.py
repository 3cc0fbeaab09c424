"""CalculiX on a mesh of tetrahedra: quadratic C3D10 elements, ``*FREQUENCY``.

CalculiX is a program of its own: on Debian and Ubuntu ``apt-get install calculix-ccx``.
"""

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from bench.record import Stopwatch
from bench.rivals.audio.outcome import MAX_FREQUENCY_HZ, Outcome
from objectfolder.making.materials import Material
from objectfolder.making.solid.solid import Solid

HOW = "apt-get install calculix-ccx"
# Mid-side nodes of a C3D10 after its corners.
EDGES = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))


def available() -> bool:
    return shutil.which("ccx") is not None


def calculix(solid: Solid, material: Material, modes: int) -> Outcome:
    """The first elastic modes, `modes` of them; seconds are those of the whole program."""
    vertices, elements = quadratic(solid.vertices, solid.tetrahedra)
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        rigid = 6 * solid.components
        (Path(folder) / "body.inp").write_text(deck(vertices, elements, material, modes + rigid))
        with watch.step("program"):
            done = subprocess.run(
                ["ccx", "-i", "body"],
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
                env={**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"},
            )
        if done.returncode != 0:
            raise RuntimeError(f"CalculiX ended with {done.returncode}: {done.stdout[-500:]}")
        frequencies_hz = frequencies((Path(folder) / "body.dat").read_text())[rigid:]
    version = re.search(r"CalculiX Version (\S+?),", done.stdout)
    used = [name for name in ("PaStiX", "PARDISO", "SPOOLES") if name.lower() in done.stdout.lower()]
    return Outcome(
        frequencies_hz[frequencies_hz < MAX_FREQUENCY_HZ] if len(frequencies_hz) < modes else frequencies_hz,
        3 * len(vertices),
        watch.cpu_s,
        {
            "elements": len(elements),
            "version": version.group(1) if version else None,
            "solver": used[0] if used else None,
        },
    )


def quadratic(vertices: np.ndarray, tetrahedra: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, 3) and elements (t, 10) with the middles of the edges."""
    ends = np.sort(tetrahedra[:, EDGES], axis=2)
    unique, middle = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    nodes = np.concatenate([vertices, vertices[unique].mean(axis=1)])
    return nodes, np.concatenate([tetrahedra, len(vertices) + middle.reshape(-1, 6)], axis=1)


def deck(nodes: np.ndarray, elements: np.ndarray, material: Material, modes: int) -> str:
    """Input of a free body, SI units."""
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{index},{x:.12e},{y:.12e},{z:.12e}" for index, (x, y, z) in enumerate(nodes, start=1)]
    lines.append("*ELEMENT, TYPE=C3D10, ELSET=BODY")
    lines += [",".join(map(str, [index, *row])) for index, row in enumerate((elements + 1).tolist(), start=1)]
    lines += [
        "*MATERIAL, NAME=STUFF",
        "*ELASTIC",
        f"{material.youngs_modulus_pa:.12e},{material.poisson_ratio:.12e}",
        "*DENSITY",
        f"{material.density_kg_m3:.12e}",
        "*SOLID SECTION, ELSET=BODY, MATERIAL=STUFF",
        "*STEP",
        "*FREQUENCY",
        f"{modes}",
        "*END STEP",
    ]
    return "\n".join(lines) + "\n"


def frequencies(dat: str) -> np.ndarray:
    """Cycles per second, all modes, from the table ``MODE NO  EIGENVALUE  RAD/TIME  CYCLES/TIME``."""
    table = dat.split("E I G E N V A L U E", 1)[1].split("P A R T I C I P A T I O N", 1)[0]
    rows = [line.split() for line in table.splitlines() if re.match(r"\s*\d+\s+[-+0-9.]+E", line)]
    return np.array([float(row[3]) for row in rows])
