"""Equal sectors of a body that turns into itself: waves around the axis are solved for on one of them.

A body that a turn by theta = 2 pi / m maps onto itself, elements and all, has modes of which that turn makes
e^(-i k theta) times the mode, k = 0 .. m - 1 (D. L. Thomas, Int. J. Numer. Meth. Engng 14, 1979). With R the
turn of vectors and s(f) the number of turns that take a function's representative g to it, coefficients are
u_f = e^(i k theta s) R^s v_g. So a wave k has the unknowns of one sector, and the waves k and m - k have the
same eigenvalues and conjugate modes.

Functions on the axis are their own images: of their three components a wave keeps those with R v = e^(-i k
theta) v, which is the one along the axis for k = 0, one across it for k = 1, and none for others up to m / 2.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from objectfolder.making.elements.space import Space

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Values = NDArray[Any]  # float64 or complex128
# Distance of a turned vertex from the one it comes to lie on, at most, over the size of the body.
MOST_OFF = 1e-7


@dataclass(frozen=True)
class Sectors:
    """A space whose elements a turn maps onto one another, the order of their corners included.

    Attributes
    ----------
    whole : all elements
    count : m, how many turns make a whole one
    point : (3,) on the axis
    axis : (3,) its direction
    elements : (t,) those of the first sector
    image : (function,) number of the representative of each function of the whole
    shift : (function,) turns from the representative to the function, 0 .. m - 1
    representatives : (g,) functions of the whole, by ascending order
    on_axis : (g,) bool, functions that are their own images
    integrals : of elements by order and Poisson's ratio, the same for all waves
    """

    whole: Space
    count: int
    point: Floats
    axis: Floats
    elements: Integers
    image: Integers
    shift: Integers
    representatives: Integers
    on_axis: NDArray[np.bool_]
    integrals: dict[tuple[int, float], Any] = field(default_factory=dict)

    @property
    def waves(self) -> range:
        """The waves that have all eigenvalues: 0 .. m / 2."""
        return range(self.count // 2 + 1)

    def is_real(self, wave: int) -> bool:
        """Whether a wave has real modes; others come in pairs of one eigenvalue."""
        return wave == 0 or 2 * wave == self.count

    def turns(self, wave: int) -> Values:
        """(m, 3, 3) what s turns make of the coefficients of a wave's representative."""
        angle = 2 * np.pi / self.count * np.arange(self.count)
        matrices = Rotation.from_rotvec(angle[:, None] * self.axis).as_matrix()
        phase = np.exp(1j * wave * angle)[:, None, None]
        return np.asarray(matrices * (phase.real.round() if self.is_real(wave) else phase))

    def axial_basis(self, wave: int) -> tuple[Values, NDArray[np.bool_]]:
        """Columns (3, 3) in which functions on the axis have components, and which of them a wave keeps."""
        first = np.eye(3)[np.abs(self.axis).argmin()]
        first = first - (first @ self.axis) * self.axis
        first /= np.linalg.norm(first)
        second = np.cross(self.axis, first)
        if wave == 1:
            circular = np.stack([first + 1j * second, first - 1j * second], axis=1) / np.sqrt(2)
            return np.concatenate([circular, self.axis[:, None]], axis=1), np.array([True, False, False])
        return np.stack([first, second, self.axis], axis=1), np.array([False, False, wave == 0])

    def expand(self, wave: int, vectors: Values, order: int) -> Floats:
        """Real modes (function, 3, k) of the whole up to an order, of unit mass, of a wave's (g, 3, k).

        The latter are of unit mass of a sector, of the same order. A mode of a wave that is not real makes
        two.
        """
        many = self.whole.up_to(order).size
        image, shift = self.image[:many], self.shift[:many]
        basis, _ = self.axial_basis(wave)
        placed = np.array(vectors)
        axial = self.on_axis[: len(vectors)]
        placed[axial] = basis @ placed[axial]
        modes = self.turns(wave)[shift] @ placed[image]
        if self.is_real(wave):
            return np.asarray(modes / np.sqrt(self.count))
        modes *= np.sqrt(2 / self.count)
        both = np.stack([modes.real, modes.imag], axis=-1)
        return both.reshape(*modes.shape[:2], -1)


def sectors_of(space: Space, straight: Floats, point: Floats, axis: Floats, count: int) -> Sectors | None:
    """Sectors of a space that `count` turns about an axis map onto itself; None where they do not.

    Shapes of elements are averaged over the turns: bending them onto a surface leaves small differences.

    Parameters
    ----------
    space
        In any unit.
    straight
        (v, 3) vertices before they were moved onto a surface, in the same unit.
    point
        (3,) on the axis, in the same unit.
    """
    turn = Rotation.from_rotvec(2 * np.pi / count * axis).as_matrix()
    vertices = straight - point
    distance, after = (np.asarray(part) for part in cKDTree(vertices).query(vertices @ turn.T))
    if distance.max() > MOST_OFF * np.abs(vertices).max():
        return None
    vertex_image, vertex_shift = _orbits(after, count)
    corners = _in_turn(space.tetrahedra, vertex_image, vertex_shift, count)
    element_after = _rows_in(after[corners], corners)
    if element_after is None:
        return None
    ordered = Space.of_corners(space.vertex_count, corners, space.order)
    function_after = np.empty(ordered.size, dtype=np.int64)
    function_after[ordered.numbers] = ordered.numbers[element_after]
    geometry = space.geometry.copy()
    geometry[: space.vertex_count] -= point
    geometry = _mean_over_turns(geometry, function_after, turn, count)
    geometry[: space.vertex_count] += point
    whole = ordered.shaped(geometry)
    first = np.flatnonzero(_orbits(element_after, count)[0] == np.arange(len(corners)))
    orbit, shift = _orbits(function_after, count)
    # As representative the function's image in the first sector, where elements then need no turn.
    used = np.unique(whole.numbers[first])
    representatives = np.sort(used[np.unique(orbit[used], return_index=True)[1]])
    number = np.full(whole.size, -1, dtype=np.int64)
    number[orbit[representatives]] = np.arange(len(representatives))
    image = number[orbit]
    shift = (shift - shift[representatives][image]) % count
    on_axis = function_after[representatives] == representatives
    return Sectors(whole, count, point, axis, first, image, shift, representatives, on_axis)


def _orbits(after: Integers, count: int) -> tuple[Integers, Integers]:
    """The least number among the images of each, (n,), and how many turns lead from that one to it, (n,)."""
    least, shift = np.arange(len(after)), np.zeros(len(after), dtype=np.int64)
    start = np.arange(len(after))
    reached = start
    for turns in range(1, count):
        reached = after[reached]  # the image of each after `turns` turns
        lower = start < least[reached]
        least[reached[lower]], shift[reached[lower]] = start[lower], turns
    return least, shift


def _in_turn(tetrahedra: Integers, image: Integers, shift: Integers, count: int) -> Integers:
    """Corners (t, 4) in an order that a turn keeps: by orbit, and of one orbit the later one last."""
    orbit, turns = image[tetrahedra], shift[tetrahedra]
    same = orbit[:, :, None] == orbit[:, None, :]
    next_to = same & ((turns[:, :, None] - turns[:, None, :]) % count == 1)
    rank = ((orbit[:, :, None] > orbit[:, None, :]) | next_to).sum(axis=2)
    result = np.empty_like(tetrahedra)
    np.put_along_axis(result, rank, tetrahedra, axis=1)
    return result


def _rows_in(rows: Integers, table: Integers) -> Integers | None:
    """Place of each row (t, 4) among those of a table; None where one is not there."""
    _, alike = np.unique(np.concatenate([rows, table]), axis=0, return_inverse=True)
    alike = alike.reshape(-1)
    place = np.full(alike.max() + 1, -1, dtype=np.int64)
    place[alike[len(rows) :]] = np.arange(len(table))
    places = place[alike[: len(rows)]]
    return places if np.all(places >= 0) else None


def _mean_over_turns(geometry: Floats, after: Integers, turn: Floats, count: int) -> Floats:
    total, at = np.zeros_like(geometry), np.arange(len(geometry))
    back = np.eye(3)
    for _ in range(count):
        total += geometry[at] @ back.T
        at, back = after[at], back @ turn.T
    return total / count


@dataclass(frozen=True)
class SectorSpace(Space):
    """Functions of a wave around the axis: the representatives of `Sectors`, on elements of one sector.

    Attributes
    ----------
    element_shapes : (t, functions of an element, 3) geometry of the elements
    frames : (t, functions of an element, 3, 3) displacement of each local function by its coefficients
    framed : (t,) bool, elements of which some frame is not the identity
    free : (function, 3) bool, coefficients that a wave has
    wave : k
    sectors : the whole
    """

    element_shapes: Floats
    frames: Values
    framed: NDArray[np.bool_]
    free: NDArray[np.bool_]
    wave: int
    sectors: Sectors

    @classmethod
    def of(cls, sectors: Sectors, wave: int) -> "SectorSpace":
        """The space of a wave."""
        whole, elements = sectors.whole, sectors.elements
        numbers = whole.numbers[elements]
        image = sectors.image[numbers]
        basis, components = sectors.axial_basis(wave)
        frames = sectors.turns(wave)[sectors.shift[numbers]]
        frames = frames.astype(np.result_type(frames, basis))
        frames[sectors.on_axis[image]] = basis
        free = np.ones((len(sectors.representatives), 3), dtype=bool)
        free[sectors.on_axis] = components
        vertex_count = int(np.searchsorted(sectors.representatives, whole.vertex_count))
        geometry, shapes = whole.geometry[sectors.representatives], whole.geometry[numbers]
        geometry[:vertex_count] -= sectors.point
        shapes[:, :4] -= sectors.point
        return cls(
            image[:, :4],
            vertex_count,
            whole.order,
            image,
            whole.orders[sectors.representatives],
            geometry,
            whole.curved[elements],
            shapes,
            frames,
            np.any(frames != np.eye(3), axis=(1, 2, 3)),
            free,
            wave,
            sectors,
        )

    def up_to(self, order: int) -> "SectorSpace":
        """Leading functions of a lower order."""
        lower = super().up_to(order)
        many = lower.numbers.shape[1]
        return replace(
            self,
            order=order,
            numbers=lower.numbers,
            orders=lower.orders,
            geometry=lower.geometry,
            element_shapes=self.element_shapes[:, :many],
            frames=self.frames[:, :many],
            free=self.free[: lower.size],
        )

    def shapes(self, elements: Integers) -> Floats:
        """Geometry of elements, (t, functions of an element, 3)."""
        return self.element_shapes[elements]

    def in_coefficients(self, elements: Integers, blocks: Values, masses: Floats) -> tuple[Values, Values]:
        """Blocks and masses of elements, both (t, functions, functions, 3, 3), in the wave's coefficients.

        Given are those of displacements, blocks alike and masses (t, functions, functions) of one axis.
        """
        frames = self.frames[elements]
        adjoint = frames.conj().swapaxes(-1, -2)[:, :, None]
        return adjoint @ blocks @ frames[:, None], masses[..., None, None] * (adjoint @ frames[:, None])

    def rigid_motions(self) -> Values:
        """Rigid motions that a wave has, coefficients (function, 3, r): two each of the waves 0 and 1."""
        basis, components = self.sectors.axial_basis(self.wave)
        directions = basis[:, components].T
        centred = np.array(self.geometry, dtype=directions.dtype)
        height = self.geometry[: self.vertex_count] @ self.sectors.axis
        centred[: self.vertex_count] -= height.mean() * self.sectors.axis
        motions = np.zeros((self.size, 3, 2 * len(directions)), dtype=directions.dtype)
        for index, direction in enumerate(directions):
            motions[: self.vertex_count, :, 2 * index] = direction
            motions[:, :, 2 * index + 1] = np.cross(direction, centred)
        axial = self.sectors.on_axis[: self.size]
        motions[axial] = basis.conj().T @ motions[axial]
        return motions
