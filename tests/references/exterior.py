"""Sound outside a vibrating surface by bempp-cl, an independent code (Betcke and Scroggs, JOSS 6, 2021).

Galerkin boundary elements, linear for the pressure and constant for the velocity, of the equation of Burton
and Miller; singular integrals by the transforms of Sauter and Schwab. It is no dependency:
`pip install bempp-cl`.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def radiated(surface: Surface, velocity: Floats, wavenumber: float, places: Floats) -> Complexes:
    """Field (places, m) outside of a closed surface whose normal derivative on it is `velocity`.

    Parameters
    ----------
    velocity
        (faces, m).
    wavenumber
        Radians a metre; time is exp(-i omega t).
    places
        (places, 3) metres.
    """
    import bempp_cl.api as bempp
    from bempp_cl.api.operators import boundary, potential
    from scipy.linalg import lu_factor, lu_solve

    grid = bempp.Grid(surface.vertices.T, surface.faces.T.astype(np.uint32))
    linear, constant = bempp.function_space(grid, "P", 1), bempp.function_space(grid, "DP", 0)
    k, coupling = wavenumber, 1j / wavenumber
    waves = boundary.helmholtz

    def dense(operator: Any) -> Complexes:
        return np.asarray(operator.weak_form().to_dense())

    matrix = dense(boundary.sparse.identity(linear, linear, linear)) / 2
    matrix = matrix - dense(waves.double_layer(linear, linear, linear, k))
    matrix = matrix + coupling * dense(waves.hypersingular(linear, linear, linear, k))
    loads = dense(boundary.sparse.identity(constant, linear, linear)) / 2
    loads = coupling * (loads + dense(waves.adjoint_double_layer(constant, linear, linear, k)))
    loads = loads + dense(waves.single_layer(constant, linear, linear, k))
    pressures = lu_solve(lu_factor(matrix), -loads @ velocity)
    single = potential.helmholtz.single_layer(constant, places.T, k)
    double = potential.helmholtz.double_layer(linear, places.T, k)
    fields = []
    for pressure, slope in zip(pressures.T, velocity.T, strict=True):
        dipoles = double.evaluate(bempp.GridFunction(linear, coefficients=pressure))
        sources = single.evaluate(bempp.GridFunction(constant, coefficients=slope.astype(complex)))
        fields.append((dipoles - sources)[0])
    return np.stack(fields, axis=1)
