"""How fast each mode loses its energy to the air, which is also how loud it is.

A mode of unit modal mass whose velocity has the amplitude 1 has the energy 1/2, and radiates the power P of
its far field: its amplitude falls at the rate P by radiation alone. The far field is solved by boundary
elements that keep the two sides of a thin wall apart, as in `radiation`, but coarse ones and at few
wavenumbers, between which the logarithm of the power is linear in that of the wavenumber. A power needs no
more: phases and directions, which need finer ones, are not asked.
"""

import numpy as np
from numpy.typing import NDArray

from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S, Radiation, order_for
from objectfolder.making.air.helmholtz import Elements
from objectfolder.making.air.radiation import (
    AREA_PER_VERTEX,
    Shapes,
    middle_of,
    normal_velocities,
    velocities_on_elements,
)
from objectfolder.making.air.remeshing import remeshed
from objectfolder.surface.surface import Surface

Floats = NDArray[np.float64]
IMPEDANCE = DENSITY_KG_M3 * SOUND_SPEED_M_S
# Vertices of the elements by their area. Rims and handles get more: edges are then made longer, each time by
# this factor, until there are `MOST_VERTICES` at most.
LOSS_VERTICES, MOST_VERTICES, LONGER = 700, 600, 1.15
# Steps from one solved wavenumber to the next: the larger of a phase across the object's radius and a share.
PHASE_STEP, SHARE_STEP = 0.3, 0.12


def radiation_dampings(surface: Surface, shapes: Shapes, frequencies_hz: Floats) -> Floats:
    """Decay rates (modes,) 1/s of the amplitudes of modes by what they radiate into free air.

    Parameters
    ----------
    surface
        Closed, outward, metres.
    shapes
        Mode shapes on it, kg^-1/2.
    frequencies_hz
        (modes,) damped, 0 where a mode does not ring: its rate is 0.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(3, 0.1)
    >>> sphere = Surface(np.array(ball.vertices), np.array(ball.faces))
    >>> def breathing(face, barycentric):
    ...     return sphere.face_normals[face][:, :, None]
    >>> rate = radiation_dampings(sphere, breathing, np.array([500.0]))[0]
    >>> x = 2 * np.pi * 500 * 0.1 / SOUND_SPEED_M_S
    >>> round(float(rate / (2 * np.pi * 0.1**2 * DENSITY_KG_M3 * SOUND_SPEED_M_S * x**2 / (1 + x**2))), 2)
    0.99
    """
    rates = np.zeros(len(frequencies_hz))
    rings = np.flatnonzero(np.asarray(frequencies_hz) > 0)
    if len(rings) == 0:
        return rates
    centre, radius = middle_of(surface)
    phases = 2 * np.pi * radius / SOUND_SPEED_M_S * np.asarray(frequencies_hz, dtype=np.float64)[rings]
    mesh = _coarse(surface)
    points, every = normal_velocities(surface, shapes)
    velocity, _ = velocities_on_elements(mesh, surface, shapes, points, every, rings)
    elements = Elements(mesh, velocity, centre, order_for(phases.max()))
    nodes = solved_phases(phases)
    above = np.clip(np.searchsorted(nodes, phases), 1, max(len(nodes) - 1, 1))
    logs = np.zeros((len(nodes), len(rings)))
    for place, phase in enumerate(nodes):
        modes = np.flatnonzero((above == place) | (above == place + 1) | (len(nodes) == 1))
        k = float(phase / radius)
        fields = elements.multipoles(order_for(phase), k, elements.solve(k, modes), modes)
        logs[place, modes] = np.log(np.maximum(_power(1j * k * IMPEDANCE * fields.T, k), 1e-300))
    rates[rings] = np.exp(_between(logs, nodes, phases, above))
    return rates


def _coarse(surface: Surface) -> Surface:
    """Few triangles on a surface."""
    edge_m = float(np.sqrt(AREA_PER_VERTEX * surface.area / LOSS_VERTICES))
    mesh = remeshed(surface, edge_m)
    while len(mesh.vertices) > MOST_VERTICES and edge_m < np.ptp(surface.bounds, axis=0).max():
        edge_m *= LONGER
        mesh = remeshed(surface, edge_m)
    return mesh


def dampings_of(radiation: Radiation) -> Floats:
    """Return the same rates (modes,) of multipoles that were solved for each mode."""
    return np.where(radiation.wavenumbers > 0, _power(radiation.multipoles, radiation.wavenumbers), 0.0)


def _power(multipoles: NDArray[np.complex128], wavenumber: Floats | float) -> Floats:
    """Mean power (modes,) W of fields of multipoles (modes, multipoles) Pa."""
    square = np.maximum(np.asarray(wavenumber), 1e-30) ** 2
    return np.asarray((np.abs(multipoles) ** 2).sum(axis=1) / (2 * IMPEDANCE * square))


def solved_phases(phases: Floats) -> Floats:
    """Return ascending phases at which to solve: a step apart at most wherever there are modes (modes,)."""
    ascending = np.unique(phases)
    nodes = [float(ascending[0])]
    while nodes[-1] < ascending[-1]:
        end = nodes[-1] + max(PHASE_STEP, SHARE_STEP * nodes[-1])
        following = float(ascending[np.searchsorted(ascending, nodes[-1], side="right")])
        nodes.append(min(end, float(ascending[-1])) if following <= end else following)
    return np.array(nodes)


def _between(logs: Floats, nodes: Floats, phases: Floats, above: NDArray[np.int64]) -> Floats:
    """Logarithms (modes,) at phases from those at nodes (nodes, modes), the one above each being given."""
    modes = np.arange(len(phases))
    if len(nodes) == 1:
        return logs[0]
    below = above - 1
    share = np.log(phases / nodes[below]) / np.log(nodes[above] / nodes[below])
    return np.asarray((1 - share) * logs[below, modes] + share * logs[above, modes])
