"""What each mode of a vibrating surface radiates: multipoles about the middle of the surface."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from objectfolder.audio.air.multipoles import DENSITY_KG_M3, SOUND_SPEED_M_S, Radiation, count_of, order_for
from objectfolder.making.air.helmholtz import QUADRATURE, Elements
from objectfolder.making.air.remeshing import remeshed
from objectfolder.surface.bounding_boxes import closest_barycentric
from objectfolder.surface.surface import SampledDistance, Surface

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# From faces (n,) and barycentric coordinates (n, 3) of a surface to displacements (n, 3, modes).
Shapes = Callable[[Integers, Floats], Floats]

PER_WAVELENGTH = 9.0  # least elements
ELEMENT_VERTICES = 2500  # of the finest elements
AREA_PER_VERTEX = 1.8  # edges^2 over the area of a vertex: 1.15 were all triangles of that edge
COARSER = 1.6  # edges of one level over those of the next finer
COARSER_EDGES = 1.4  # edges of the elements that a solution is compared with over its own
CAUTION = 1.5  # stated error over the difference of the two, chosen on a sphere and a bell
GOOD = 0.05  # stated error above which a mode has finer elements, where there are
MISFIT = 0.06  # of velocities on elements, before they are mended, up to which a mode has them
PATCH_ROUNDS = 4  # times the means of velocities over patches
WAVENUMBER_GROUP = 0.04  # of wavenumbers solved at once times the object's radius, from least to largest
FACES_AT_ONCE = 4096  # faces whose shapes are read at once


def radiate(surface: Surface, shapes: Shapes, frequencies_hz: Floats) -> Radiation:
    """Solve the exterior Helmholtz problem of each mode.

    Parameters
    ----------
    surface
        Closed, outward, metres.
    shapes
        Mode shapes on it, kg^-1/2.
    frequencies_hz
        (modes,) damped, 0 where a mode does not ring: it then radiates nothing.

    Examples
    --------
    >>> import numpy as np
    >>> corners = 0.1 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1.0]])
    >>> faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    >>> octahedron = Surface(corners, np.array(faces))
    >>> def breathing(face, barycentric):
    ...     return octahedron.face_normals[face][:, :, None]
    >>> radiation = radiate(octahedron, breathing, np.array([500.0]))
    >>> round(float(abs(radiation.multipoles[0, 0])) / (1.204 * 2 * np.pi * 500 * octahedron.area / 3.545), 1)
    0.9
    """
    centre, radius = middle_of(surface)
    wavenumbers = 2 * np.pi * np.array(frequencies_hz, dtype=np.float64) / SOUND_SPEED_M_S
    highest = order_for(wavenumbers.max(initial=0.0) * radius)
    multipoles = np.zeros((len(wavenumbers), count_of(highest)), dtype=np.complex128)
    radiation = Radiation(centre, radius, wavenumbers.copy(), multipoles, np.zeros(len(wavenumbers)))
    points, true = normal_velocities(surface, shapes)
    waiting = wavenumbers > 0
    for edge_m, finest in _levels(surface.area):
        tried = np.flatnonzero(waiting & (finest | (PER_WAVELENGTH * edge_m * wavenumbers <= 2 * np.pi)))
        if len(tried) == 0:
            continue
        mesh = remeshed(surface, edge_m)
        velocity, misfit = velocities_on_elements(mesh, surface, shapes, points, true, tried)
        good = (misfit <= MISFIT) | finest
        modes = tried[good]
        if len(modes) == 0:
            continue
        coarse = remeshed(surface, COARSER_EDGES * edge_m)
        coarsely = velocities_on_elements(coarse, surface, shapes, points, true, modes)[0]
        elements = (
            Elements(mesh, velocity[:, :, good], centre, highest),
            Elements(coarse, coarsely, centre, highest),
        )
        _solve(radiation, elements, modes, wavenumbers[modes])
        waiting[modes] = (radiation.residuals[modes] > GOOD) & (not finest)
    return radiation


def _solve(
    radiation: Radiation, elements: tuple[Elements, Elements], modes: Integers, wavenumbers: Floats
) -> None:
    """Write what modes of wavenumbers radiate by the finer elements, and how far the coarser are from it."""
    for group in together(wavenumbers * radiation.radius_m):
        members, k = modes[group], float(wavenumbers[group].mean())
        order = order_for(k * radiation.radius_m)
        fine, coarse = (level.multipoles(order, k, level.solve(k, group), group) for level in elements)
        radiation.multipoles[members, : len(fine)] = 1j * k * SOUND_SPEED_M_S * DENSITY_KG_M3 * fine.T
        # The far field over all directions has the norm of its multipoles.
        size = np.maximum(np.linalg.norm(fine, axis=0), 1e-300)
        radiation.residuals[members] = CAUTION * np.linalg.norm(fine - coarse, axis=0) / size
        radiation.wavenumbers[members] = k


def together(phases: Floats) -> Iterator[Integers]:
    """Yield groups of nearly equal wavenumbers times a radius (n,), as indices.

    What an object radiates turns with the phases across it: 0.02 off are up to .3 dB in a loud direction.
    """
    order = np.argsort(phases, kind="stable")
    start = 0
    while start < len(order):
        stop = int(np.searchsorted(phases[order], WAVENUMBER_GROUP + phases[order[start]], side="right"))
        yield order[start:stop]
        start = stop


def _levels(area: float) -> list[tuple[float, bool]]:
    """Edges of elements, metres, coarse to fine, and whether they are the finest."""
    finest = float(np.sqrt(AREA_PER_VERTEX * area / ELEMENT_VERTICES))
    return [(finest * COARSER**step, step == 0) for step in (2, 1, 0)]


def middle_of(surface: Surface) -> tuple[Floats, float]:
    """Middle (3,) of the bounding box, and the radius of the sphere about it round a surface."""
    centre = surface.bounds.mean(axis=0)
    return centre, float(np.linalg.norm(surface.vertices - centre, axis=1).max())


def normal_velocities(surface: Surface, shapes: Shapes) -> tuple[Floats, Floats]:
    """Middles (faces, 3) of a surface's faces, and the normal components (faces, modes) of shapes there."""
    points = surface.vertices[surface.faces].mean(axis=1)
    middles = np.arange(len(points)), np.full((len(points), 3), 1 / 3)
    return points, _normal_velocity(surface, shapes, middles, surface.face_normals)


def _normal_velocity(
    surface: Surface, shapes: Shapes, places: tuple[Integers, Floats], normals: Floats
) -> Floats:
    """Normal components (n, modes) at places of the surface.

    The normal is the surface's where it is within 60 degrees of the one given, (n, 3), which it is but at
    edges.
    """
    face, barycentric = places
    own = surface.face_normals[face]
    normals = np.where((own * normals).sum(axis=1, keepdims=True) > 0.5, own, normals)
    parts = []
    for start in range(0, len(face), FACES_AT_ONCE):
        chunk = slice(start, start + FACES_AT_ONCE)
        parts.append(np.einsum("nk,nkm->nm", normals[chunk], shapes(face[chunk], barycentric[chunk])))
    return np.concatenate(parts)


def _nearest(surface: Surface, points: Floats) -> tuple[Integers, Floats]:
    """Faces (n,) nearest to points (n, 3), and barycentric coordinates (n, 3) in them."""
    face = SampledDistance(surface).nearest(points)[2]
    return face, closest_barycentric(surface.vertices[surface.faces[face]], points)


def velocities_on_elements(
    mesh: Surface, surface: Surface, shapes: Shapes, points: Floats, every: Floats, modes: Integers
) -> tuple[Floats, Floats]:
    """Velocities (t, 3, m) at corners of elements, and how far off the true ones they were, relative (m,).

    `every` (faces, modes) is that of the surface in its `points`. Three points of each element give its
    linear part, whose means over the patches of vertices are off by the error. What they are short of is
    added, time and again. Then the net flow is the true one: what little a slow mode radiates would drown in
    one that it has not.
    """
    true = every[:, modes]
    within = np.einsum("qa,tak->tqk", QUADRATURE[0], mesh.vertices[mesh.faces]).reshape(-1, 3)
    normals, places = np.repeat(mesh.face_normals, 3, axis=0), _nearest(surface, within)
    at_points = _normal_velocity(surface, lambda *place: shapes(*place)[:, :, modes], places, normals)
    velocity = np.einsum(
        "cq,tqm->tcm", np.linalg.inv(QUADRATURE[0]), at_points.reshape(len(mesh.faces), 3, -1)
    )
    means = _PatchMeans(mesh, surface.face_areas, *_nearest(mesh, points))
    size = np.sqrt(np.maximum(surface.face_areas @ true**2, 1e-300))
    missing = means.missing(true, velocity)
    misfit = means.norm(missing) / size
    for _ in range(PATCH_ROUNDS):
        velocity = velocity + missing[mesh.faces]
        missing = means.missing(true, velocity)
    flow = np.einsum("t,tcm->m", mesh.face_areas / 3, velocity)
    return velocity + (surface.face_areas @ true - flow) / mesh.area, misfit


class _PatchMeans:
    """Means over the patches of a mesh's vertices of what lies at places of it, each with a share of area.

    Parameters
    ----------
    mesh
        Triangles.
    shares_m2, face, barycentric
        (p,) areas, (p,) triangles that have them, and (p, 3) where.
    """

    def __init__(self, mesh: Surface, shares_m2: Floats, face: Integers, barycentric: Floats) -> None:
        self._face, self._barycentric = face, barycentric
        shares = (shares_m2[:, None] * barycentric).reshape(-1)
        places = mesh.faces[face].reshape(-1), np.repeat(np.arange(len(face)), 3)
        self._sums = sparse.csr_matrix((shares, places), (len(mesh.vertices), len(face)))
        own = np.bincount(mesh.faces.reshape(-1), np.repeat(mesh.face_areas / 3, 3), len(mesh.vertices))
        # A patch that has places of more than its area would be mended too far.
        self._areas = np.maximum(own, self._sums.sum(axis=1).A1)

    def missing(self, true: Floats, velocity: Floats) -> Floats:
        """Means (n, m) of what velocities (t, 3, m) at corners of triangles are short of true ones (p, m)."""
        element_velocity = np.einsum("pc,pcm->pm", self._barycentric, velocity[self._face])
        return np.asarray(self._sums @ (true - element_velocity)) / self._areas[:, None]

    def norm(self, means: Floats) -> Floats:
        """Norms (m,) over the area of means (n, m)."""
        return np.asarray(np.sqrt(self._areas @ means**2))
