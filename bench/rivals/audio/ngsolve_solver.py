"""NGSolve on a mesh of tetrahedra, straight sides: its assembly and Cholesky factors, ARPACK around them.

NGSolve needs an environment of its own (``python -m venv ENV``, ``ENV/bin/pip install ngsolve scipy``), named
by the variable NGSOLVE_PYTHON or the option ``--ngsolve-python``. Run by it, this file is the program that
solves: ``ENV/bin/python ngsolve.py IN.npz OUT.json``; it imports nothing of the project then.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

HOW = "python -m venv ENV; ENV/bin/pip install ngsolve scipy; NGSOLVE_PYTHON=ENV/bin/python"
# Of the dimensionless eigenvalues.
SHIFT = 0.05


def available(python: str | None) -> bool:
    """Whether that Python has NGSolve."""
    if python is None:
        return False
    asked = [python, "-c", "import ngsolve"]
    return subprocess.run(asked, capture_output=True, check=False).returncode == 0


def ngsolve(python: str, solid: Any, *, material: Any, order: int, modes: int) -> Any:
    """The first elastic modes, `modes` of them, as an `Outcome`."""
    from bench.rivals.audio.outcome import Outcome

    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.npz", Path(folder) / "out.json"
        np.savez(
            source,
            vertices=solid.vertices,
            tetrahedra=solid.tetrahedra,
            order=order,
            modes=modes + 6 * solid.components,
            shear_speed_m_s=material.shear_speed_m_s,
            poisson_ratio=material.poisson_ratio,
        )
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "NGS_NUM_THREADS": "1"}
        done = subprocess.run(
            [python, str(Path(__file__).resolve()), str(source), str(target)],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
        )
        if done.returncode != 0:
            raise RuntimeError(f"NGSolve ended with {done.returncode}: {done.stderr[-500:]}")
        answer = json.loads(target.read_text())
    found = np.array(answer["frequencies_hz"])[6 * solid.components :]
    notes = {"elements": len(solid.tetrahedra), "version": answer["version"]}
    return Outcome(found, answer["unknowns"], answer["cpu_s"], notes)


def main(source: str, target: str) -> None:
    """Solve in the environment that has NGSolve; lengths in units of the longest side, mu = 1, density 1."""
    import ngsolve as ngs
    from scipy import sparse
    from scipy.sparse.linalg import LinearOperator, eigsh

    given = np.load(source)
    length = float(np.ptp(given["vertices"], axis=0).max())
    seconds, start = {}, time.process_time()
    domain = ngs.Mesh(_mesh(given["vertices"] / length, given["tetrahedra"]))
    space = ngs.VectorH1(domain, order=int(given["order"]))
    stiffness, mass = _forms(space, float(given["poisson_ratio"]))
    seconds["assembly"] = time.process_time() - start
    start = time.process_time()
    shifted = stiffness.mat.CreateMatrix()
    shifted.AsVector().data = stiffness.mat.AsVector() + SHIFT * mass.mat.AsVector()
    factors = shifted.Inverse(space.FreeDofs(), inverse="sparsecholesky")
    right, left = shifted.CreateColVector(), shifted.CreateColVector()

    def solve(values: np.ndarray) -> np.ndarray:
        right.FV().NumPy()[:] = values.ravel()
        left.data = factors * right
        return left.FV().NumPy().copy()

    seconds["factorisation"] = time.process_time() - start
    start = time.process_time()
    matrices = []
    for form in (stiffness, mass):
        entries, columns, starts = form.mat.CSR()
        matrices.append(sparse.csr_matrix((entries, columns, starts), shape=(space.ndof, space.ndof)))
    inverse = LinearOperator(matrices[0].shape, matvec=solve, dtype=np.float64)
    modes = int(given["modes"])
    squared, _ = eigsh(matrices[0], modes, matrices[1], sigma=-SHIFT, OPinv=inverse, tol=1e-7)
    seconds["eigenvectors"] = time.process_time() - start
    radians = float(given["shear_speed_m_s"]) / length
    answer = {
        "frequencies_hz": (np.sqrt(np.maximum(np.sort(squared), 0)) * radians / (2 * np.pi)).tolist(),
        "unknowns": int(space.ndof),
        "cpu_s": seconds,
        "version": ngs.__version__,
    }
    Path(target).write_text(json.dumps(answer))


def _mesh(vertices: np.ndarray, tetrahedra: np.ndarray) -> Any:
    """The same tetrahedra (t, 4) as a mesh of Netgen."""
    import netgen.meshing as netgen

    mesh = netgen.Mesh(dim=3)
    points = [mesh.Add(netgen.MeshPoint(netgen.Pnt(*point))) for point in vertices.tolist()]
    corner = vertices[tetrahedra]
    inverted = np.linalg.det(corner[:, 1:] - corner[:, :1]) > 0  # Netgen's orientation is the other one
    ordered = np.where(inverted[:, None], tetrahedra[:, [0, 2, 1, 3]], tetrahedra)
    face = mesh.Add(netgen.FaceDescriptor(surfnr=1, domin=1, bc=1))
    for row in ordered.tolist():
        mesh.Add(netgen.Element3D(1, [points[i] for i in row]))
    faces = tetrahedra[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    for row in faces[first[count == 1]].tolist():
        mesh.Add(netgen.Element2D(face, [points[i] for i in row]))
    return mesh


def _forms(space: Any, poisson_ratio: float) -> tuple[Any, Any]:
    """Assembled stiffness and mass."""
    import ngsolve as ngs

    lame = 2 * poisson_ratio / (1 - 2 * poisson_ratio)
    u, v = space.TnT()

    def strain(w: Any) -> Any:
        return 0.5 * (ngs.Grad(w) + ngs.Grad(w).trans)

    # condense would leave out inner unknowns, which the mass also has.
    stiffness = ngs.BilinearForm(space, symmetric=False)
    stiffness += (2 * ngs.InnerProduct(strain(u), strain(v)) + lame * ngs.div(u) * ngs.div(v)) * ngs.dx
    mass = ngs.BilinearForm(space, symmetric=False)
    mass += ngs.InnerProduct(u, v) * ngs.dx
    stiffness.Assemble()
    mass.Assemble()
    return stiffness, mass


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
