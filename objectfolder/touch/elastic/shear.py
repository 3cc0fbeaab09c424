"""An elastic surface sheared and twisted under a rigid object, by Coulomb's law: what sticks and what slips.

The load grows from one state to the next in proportion. Tractions q with |q| <= friction times pressure move
the surface by u = K q, and the pressure moves it as well. Where it sticks u has grown by what the object has
shifted and turned since; where it slips q is at its limit, and points the way the object slides. These are
the tractions of least energy q K q / 2 - q u0 that add up to the load, where u0 is what has been kept from
before: a convex problem (J. J. Kalker 1990, Three-Dimensional Elastic Bodies in Rolling Contact, 4.2).
Accelerated projected gradients find them (A. Beck & M. Teboulle 2009, SIAM J. Imaging Sciences 2),
restarted as by B. O'Donoghue & E. Candes 2015, Found. Comput. Math. 15.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from objectfolder.errors import InputError, SimulationError
from objectfolder.jit import inner, kernel
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.tangential_influence import TangentialCompliance, tangential_compliance

SHEAR_TOLERANCE, SHEAR_ITERATIONS = 1e-4, 2000
# Where all is at the limit the slope may be 0: a step is then too long, and halved.
BALANCE_STEPS, LEAST_SLOPE = 60, 1e-9


@dataclass(frozen=True, eq=False)
class Shear:
    """A sheared contact on the grid of its `Contact`; directions are 0 along rows' order, 1 along columns'.

    Parameters
    ----------
    traction_pa
        (2, rows, columns) float64 on the elastic surface.
    displacement_m
        (2, rows, columns) float64 of the surface sideways, by tractions and by pressure.
    shift_m
        (2,) float64: how far the object has moved before it slides, against the back of the elastic body,
        where the centre of pressure is.
    sticking
        (rows, columns) bool: cells in contact that have not slipped since the state before.
    sliding
        Whether all of the contact slips: a larger load is not borne.
    relative_residual
        Largest error of what sticks, over the largest displacement by a uniform share of the friction.
    iterations
        Of projected gradients.
    twist_rad
        How far the object has turned, from direction 0 towards 1, before it slides.
    """

    traction_pa: np.ndarray
    displacement_m: np.ndarray
    shift_m: np.ndarray
    sticking: np.ndarray
    sliding: bool
    relative_residual: float
    iterations: int
    twist_rad: float = 0.0


def unsheared(shape: tuple[int, int]) -> Shear:
    """State of a surface (rows, columns) that nothing has touched: where a press with friction begins.

    Examples
    --------
    >>> int(unsheared((2, 3)).sticking.sum())
    0
    """
    nothing = np.zeros((2, *shape))
    return Shear(nothing, nothing.copy(), np.zeros(2), np.zeros(shape, dtype=bool), False, 0.0, 0)


def solve_shear(
    contact: Contact,
    elastomer: Elastomer,
    friction: float,
    force_n: ArrayLike,
    *,
    torque_nm: float | None = None,
    before: Shear | None = None,
    tolerance: float = SHEAR_TOLERANCE,
    maximum_iterations: int = SHEAR_ITERATIONS,
) -> Shear:
    """Shear a contact by a load that grows in proportion; the pressure is as without friction.

    Parameters
    ----------
    contact
        Of `solve_contact`.
    elastomer
        The same.
    friction
        Coulomb's coefficient, 0 or more.
    force_n
        (2,) on the elastic surface. What exceeds friction times the normal force is not borne.
    torque_nm
        About the centre of pressure, from direction 0 towards 1. None holds the object from turning,
        whatever torque that takes.
    before
        The state from which the load has changed to this one, of the same grid: loads and contacts that
        rise, fall and turn round are followed state by state. None is a contact that was pressed without
        friction.
    tolerance
        Largest `Shear.relative_residual`.

    Raises
    ------
    InputError
        A friction below 0, a force that is not two numbers, a torque that is none, a state of another grid.
    SimulationError
        No convergence.

    Examples
    --------
    >>> import numpy as np
    >>> from objectfolder.touch import Elastomer, solve_contact
    >>> y, z = np.meshgrid(*[np.linspace(-0.004, 0.004, 65)] * 2)
    >>> gel = Elastomer(1e6, 0.5, None)
    >>> contact = solve_contact((y**2 + z**2) / (2 * 0.02), 0.000125, gel, force_n=1.0)
    >>> shear = solve_shear(contact, gel, 0.8, (0.4, 0.0))
    >>> radii = np.sqrt(shear.sticking.sum() / contact.mask.sum())
    >>> round(radii, 1), round((1 - 0.4 / 0.8) ** (1 / 3), 1)  # Cattaneo and Mindlin
    (0.8, 0.8)
    >>> back = solve_shear(contact, gel, 0.8, (0.0, 0.0), before=shear)
    >>> round(back.shift_m[0] / shear.shift_m[0], 2)  # what slipped stays
    0.06
    """
    force = np.asarray(force_n, dtype=np.float64)
    if not (np.isfinite(friction) and friction >= 0):
        raise InputError("friction", f"{friction}", "It must be a number, 0 or more.")
    if force.shape != (2,) or not np.isfinite(force).all():
        raise InputError("force_n", repr(force_n), "Give two numbers.")
    if torque_nm is not None and not np.isfinite(torque_nm):
        raise InputError(
            "torque_nm", f"{torque_nm}", "Give a number, or None for an object that cannot turn."
        )
    if before is not None and before.sticking.shape != contact.mask.shape:
        finding = f"is of {before.sticking.shape} cells, the contact of {contact.mask.shape}"
        raise InputError("before", finding, "Use one grid throughout.")
    rows, columns = (_span(contact.mask.any(axis=axis)) for axis in (1, 0))
    limit = friction * contact.pressure_pa[rows, columns]
    pressed = _moved_by_pressure(contact, elastomer)
    if not limit.any():
        return _without_friction(contact, pressed, before, bool(force.any() or torque_nm))
    part = tangential_compliance(elastomer, limit.shape, contact.pitch_m)
    touching = limit > 0
    load = _Load.on(contact, limit, touching, force, torque_nm)
    previous = np.zeros((2, len(load.limit)))
    if before is not None:
        previous = (before.displacement_m - pressed)[:, rows, columns][:, touching]
    inside = np.zeros((2, *limit.shape))
    direction = load.sliding()
    if direction is not None:
        inside[:, touching] = load.limit * _unit(load.field(direction))
        moved = part.displacement(inside)[:, touching] - previous
        # What sticks last is what has moved furthest.
        field = load.field(direction)
        further = (np.sum(moved * field, axis=0) / np.maximum(np.sum(field**2, axis=0), 1e-300)).max()
        change, residual, spent = further * direction, 0.0, 0
    else:
        start = np.zeros((2, len(load.limit)))
        if before is not None:
            start = before.traction_pa[:, rows, columns][:, touching]
        inside[:, touching], change, residual, spent = _least_energy(
            part, load, touching, previous, start, tolerance, maximum_iterations
        )
    traction, sticking = np.zeros((2, *contact.mask.shape)), np.zeros_like(contact.mask)
    traction[:, rows, columns] = inside
    sticking[rows, columns] = np.hypot(*inside) < limit * (1 - 1e-9)
    whole = tangential_compliance(elastomer, contact.mask.shape, contact.pitch_m)
    shift, twist = (np.zeros(2), 0.0) if before is None else (before.shift_m, before.twist_rad)
    return Shear(
        traction,
        whole.displacement(traction) + pressed,
        shift + change[:2],
        sticking & (direction is None),
        direction is not None,
        residual,
        spent,
        twist + float(change[2]) / load.lever_m,
    )


def _span(places: np.ndarray, step: int = 8) -> slice:
    """First to last place that is true, and some beyond, so that few sizes occur."""
    indices = np.flatnonzero(places)
    if len(indices) == 0:
        return slice(0, 0)
    length = min(-(-int(indices[-1] + 1 - indices[0]) // step) * step, len(places))
    first = min(int(indices[0]), len(places) - length)
    return slice(first, first + length)


def _without_friction(contact: Contact, pressed: np.ndarray, before: Shear | None, pushed: bool) -> Shear:
    """Shear of a contact that bears none, or of no contact: it slides as soon as it is pushed."""
    shift, twist = (np.zeros(2), 0.0) if before is None else (before.shift_m, before.twist_rad)
    nothing, sticking = np.zeros((2, *contact.mask.shape)), np.zeros_like(contact.mask)
    return Shear(nothing, pressed, shift, sticking, pushed, 0.0, 0, twist)


def _moved_by_pressure(contact: Contact, elastomer: Elastomer) -> np.ndarray:
    whole = tangential_compliance(elastomer, contact.mask.shape, contact.pitch_m)
    return whole.displacement_by_pressure(contact.pressure_pa)


@dataclass(frozen=True, eq=False)
class _Load:
    """What n cells in contact bear: the sum of their tractions, and of those along `arm` (2, n).

    An arm is what a turn by 1 / `lever_m` moves a cell by, per metre; so both sums are of one kind. Without
    a torque the object is held from turning.
    """

    limit: np.ndarray
    arm: np.ndarray
    total: np.ndarray
    lever_m: float
    turns: bool

    @classmethod
    def on(
        cls,
        contact: Contact,
        limit: np.ndarray,
        touching: np.ndarray,
        force: np.ndarray,
        torque: float | None,
    ) -> "_Load":
        place = np.stack(np.nonzero(touching)) * np.array(contact.pitch_m)[:, None]
        away = place - np.average(place, axis=1, weights=limit[touching])[:, None]
        # Of a single cell any would do.
        lever = float(np.sqrt(np.mean(np.sum(away**2, axis=0)))) or max(contact.pitch_m)
        arm = np.stack([-away[1], away[0]]) / lever
        total = np.array([*force, (torque or 0.0) / lever]) / (contact.pitch_m[0] * contact.pitch_m[1])
        return cls(limit[touching], arm, total, lever, torque is not None)

    def field(self, motion: np.ndarray) -> np.ndarray:
        """Displacements (2, n) by a motion (3,): along both directions, and turning."""
        return np.asarray(motion[:2, None] + motion[2] * self.arm)

    def sliding(self) -> np.ndarray | None:
        """Motion (3,) with which the object slides under the load; None where the load is borne.

        The load is borne where no motion does more work by it than friction takes. Of the motions by which
        it does a unit of work, friction takes least of the one that it would slide with.
        """
        if not self.total.any():
            return None
        size = float(np.linalg.norm(self.total))
        along = self.total / size
        if not self.turns:
            return along if size >= float(self.limit.sum()) else None
        aside = np.linalg.svd(along[None])[2][1:]
        scale = float(self.limit.sum())

        def taken(weights: np.ndarray) -> tuple[float, np.ndarray]:
            field = self.field(along + weights @ aside)
            speed = np.sqrt(np.sum(field**2, axis=0) + 1e-18)
            pull = self.limit * field / speed
            slope = np.array([*pull.sum(axis=1), float(np.sum(pull * self.arm))])
            return float(self.limit @ speed) / scale, aside @ slope / scale

        optimum = minimize(taken, np.zeros(2), jac=True, method="BFGS", options={"gtol": 1e-9})
        motion = along + optimum.x @ aside
        return np.asarray(motion / np.linalg.norm(motion)) if size >= optimum.fun * scale else None


def _unit(field: np.ndarray) -> np.ndarray:
    return np.asarray(field / np.maximum(np.hypot(*field), 1e-300))


def _least_energy(
    compliance: TangentialCompliance,
    load: _Load,
    touching: np.ndarray,
    previous: np.ndarray,
    start: np.ndarray,
    tolerance: float,
    most: int,
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Tractions (2, n) of a given sum, how far the object moves (3,), the residual, and iterations spent."""
    stiffness, box = 1 / compliance.greatest, np.zeros((2, *touching.shape))

    def displaced(traction: np.ndarray) -> np.ndarray:
        box[:, touching] = traction
        return compliance.displacement(box)[:, touching]

    uniform = load.limit * load.field(load.total) / load.limit.sum()
    traction = uniform if not start.any() else start
    scale = float(np.abs(displaced(uniform)).max()) + float(np.abs(previous).max())
    ahead, momentum, change = traction, 1.0, np.zeros(3)
    for iteration in range(1, most + 1):
        moved = displaced(ahead) - previous
        new, change = _balanced(ahead - stiffness * moved, load, stiffness * change)
        change = change / stiffness
        error_pa = float(np.abs(new - ahead).max())
        residual = error_pa / (stiffness * scale) if error_pa > 0 else 0.0
        if residual <= tolerance:
            return new, change, residual, iteration
        if float(np.vdot(new - ahead, new - traction)) < 0:
            momentum = 1.0
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (momentum - 1) / following * (new - traction)
        traction, momentum = new, following
    finding = f"what sticks is wrong by {residual:.2g} of what moves after {most} iterations"
    raise SimulationError("shear", finding, "Allow more iterations or a larger tolerance.")


def _balanced(aim: np.ndarray, load: _Load, lift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tractions (2, n) within the limit of a load, and of its sum, that are nearest to wanted ones.

    They are the wanted ones plus the field of a lift (3,), cut to the limit: Newton's method on the convex
    function of the lift whose slope is what the sum is too much by. Also returns the lift.
    """
    cut, close = np.empty_like(aim), 1e-9 * float(load.limit.sum())
    free = 3 if load.turns else 2
    slope, curvature = np.empty(3), np.empty((3, 3))
    at = (aim, load.limit, load.arm, load.total)
    energy = _cut(*at, lift, cut, slope, curvature)
    for _ in range(BALANCE_STEPS):
        if float(np.abs(slope[:free]).max()) <= close:
            break
        steep = curvature[:free, :free] + LEAST_SLOPE * len(load.limit) * np.eye(free)
        step = np.zeros(3)
        step[:free] = np.linalg.solve(steep, slope[:free])
        before = energy
        energy = _cut(*at, lift - step, cut, slope, curvature)
        while energy > before + 1e-12 * abs(before):
            step /= 2
            energy = _cut(*at, lift - step, cut, slope, curvature)
        lift = lift - step
    return cut, lift


@inner(kernel)
def limited_traction(a, b, most, one):
    """Length of a traction, the share of it that a limit leaves, and its direction, 0 within the limit.

    Batches call it, too: all numbers are of the type of `one`.
    """
    length = math.sqrt(a * a + b * b)
    if length <= most:
        return length, one, one - one, one - one
    return length, most / length, a / length, b / length


@kernel
def _cut(aim, limit, arm, total, lift, cut, slope, curvature):
    """Fill in the tractions that a lift gives, and slope (3,) and curvature (3, 3) of what it makes least."""
    energy = -total[0] * lift[0] - total[1] * lift[1] - total[2] * lift[2]
    slope[:] = -total
    curvature[:] = 0.0
    for i in range(len(limit)):
        e, f = arm[0, i], arm[1, i]
        a, b = aim[0, i] + lift[0] + lift[2] * e, aim[1, i] + lift[1] + lift[2] * f
        most = limit[i]
        length, share, c, d = limited_traction(a, b, most, 1.0)
        if length <= most:
            energy += length * length / 2
        else:
            energy += most * (length - most / 2)
        xx, xy, yy = share * (1 - c * c), -share * c * d, share * (1 - d * d)
        a, b = share * a, share * b
        cut[0, i], cut[1, i] = a, b
        slope[0] += a
        slope[1] += b
        slope[2] += a * e + b * f
        ex, ey = xx * e + xy * f, xy * e + yy * f
        curvature[0, 0] += xx
        curvature[0, 1] += xy
        curvature[1, 1] += yy
        curvature[0, 2] += ex
        curvature[1, 2] += ey
        curvature[2, 2] += ex * e + ey * f
    curvature[1, 0], curvature[2, 0], curvature[2, 1] = curvature[0, 1], curvature[0, 2], curvature[1, 2]
    return energy
