"""An elastic surface sheared under a rigid object, by Coulomb's law: what sticks and what slips.

The tangential force grows in one direction while the pressure stays. Tractions q with |q| <= friction times
pressure move the surface by u = K q. Where it sticks u is the object's shift; where it slips q is at its
limit, and points the way the object slides. These are the tractions of least energy q K q / 2 that add up to
the force, a convex problem (J. J. Kalker 1990, Three-Dimensional Elastic Bodies in Rolling Contact, 4.2).
Accelerated projected gradients find them (A. Beck & M. Teboulle 2009, SIAM J. Imaging Sciences 2),
restarted as by B. O'Donoghue & E. Candes 2015, Found. Comput. Math. 15.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from objectfolder.errors import InputError, SimulationError
from objectfolder.jit import kernel
from objectfolder.touch.elastic.contact_problem import Contact
from objectfolder.touch.elastic.elastomer import Elastomer
from objectfolder.touch.elastic.tangential_influence import TangentialCompliance, tangential_compliance

TOLERANCE, MAXIMUM_ITERATIONS = 1e-4, 2000
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
        (2,) float64: how far the object has moved before it slides, against the back of the elastic body.
    sticking
        (rows, columns) bool: cells in contact that have not slipped.
    sliding
        Whether all of the contact slips: a larger force is not borne.
    relative_residual
        Largest error of what sticks, over the largest displacement by a uniform share of the friction.
    iterations
        Of projected gradients.
    """

    traction_pa: np.ndarray
    displacement_m: np.ndarray
    shift_m: np.ndarray
    sticking: np.ndarray
    sliding: bool
    relative_residual: float
    iterations: int


def solve_shear(
    contact: Contact,
    elastomer: Elastomer,
    friction: float,
    force_n: ArrayLike,
    *,
    tolerance: float = TOLERANCE,
    maximum_iterations: int = MAXIMUM_ITERATIONS,
) -> Shear:
    """Shear a contact by a force that grows in one direction; the pressure is as without friction.

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
    tolerance
        Largest `Shear.relative_residual`.

    Raises
    ------
    InputError
        A friction below 0, a force that is not two numbers.
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
    """
    force = np.asarray(force_n, dtype=np.float64)
    if not (np.isfinite(friction) and friction >= 0):
        raise InputError("friction", f"{friction}", "It must be a number, 0 or more.")
    if force.shape != (2,) or not np.isfinite(force).all():
        raise InputError("force_n", repr(force_n), "Give two numbers.")
    rows, columns = (_span(contact.mask.any(axis=axis)) for axis in (1, 0))
    limit = friction * contact.pressure_pa[rows, columns]
    if not limit.any():
        return _without_friction(contact, elastomer, bool(force.any()))
    part = tangential_compliance(elastomer, limit.shape, contact.pitch_m)
    total, size = force / (contact.pitch_m[0] * contact.pitch_m[1]), float(np.linalg.norm(force))
    sliding = float(np.linalg.norm(total)) >= float(limit.sum())
    if sliding:
        inside = limit * (force / size)[:, None, None]
        # What sticks last is what has moved furthest.
        furthest = np.tensordot(force / size, part.displacement(inside), 1)[limit > 0].max()
        shift, residual, spent = furthest * force / size, 0.0, 0
    else:
        inside, shift, residual, spent = _least_energy(part, limit, total, tolerance, maximum_iterations)
    traction, sticking = np.zeros((2, *contact.mask.shape)), np.zeros_like(contact.mask)
    traction[:, rows, columns] = inside
    sticking[rows, columns] = np.hypot(*inside) < limit * (1 - 1e-9)
    moved = _moved(contact, elastomer, traction)
    return Shear(traction, moved, shift, sticking & (not sliding), sliding, residual, spent)


def _span(wanted: np.ndarray, step: int = 8) -> slice:
    """First to last wanted place and some beyond, so that few sizes occur."""
    found = np.flatnonzero(wanted)
    if len(found) == 0:
        return slice(0, 0)
    length = min(-(-int(found[-1] + 1 - found[0]) // step) * step, len(wanted))
    first = min(int(found[0]), len(wanted) - length)
    return slice(first, first + length)


def _without_friction(contact: Contact, elastomer: Elastomer, pushed: bool) -> Shear:
    """Shear of a contact that bears none, or of no contact: it slides as soon as it is pushed."""
    nothing, none = np.zeros((2, *contact.mask.shape)), np.zeros(2)
    sticking = np.zeros_like(contact.mask)
    return Shear(nothing, _moved(contact, elastomer, nothing), none, sticking, pushed, 0.0, 0)


def _moved(contact: Contact, elastomer: Elastomer, traction: np.ndarray) -> np.ndarray:
    whole = tangential_compliance(elastomer, contact.mask.shape, contact.pitch_m)
    return whole.displacement(traction) + whole.displacement_by_pressure(contact.pressure_pa)


def _least_energy(
    compliance: TangentialCompliance, limit: np.ndarray, total: np.ndarray, tolerance: float, most: int
) -> tuple[np.ndarray, np.ndarray, float, int]:
    """Tractions (2, rows, columns) of a given sum, the shift (2,), the residual, and iterations spent."""
    stiffness, touching, box = 1 / compliance.greatest, limit > 0, np.zeros((2, *limit.shape))
    most_pa = limit[touching]
    traction = most_pa * (total / most_pa.sum())[:, None]
    ahead, momentum, shift, scale = traction, 1.0, np.zeros(2), 0.0
    for iteration in range(1, most + 1):
        box[:, touching] = ahead
        moved = compliance.displacement(box)[:, touching]
        new, shift = _balanced(ahead - stiffness * moved, most_pa, total, stiffness * shift)
        shift = shift / stiffness
        error_pa = float(np.abs(new - ahead).max())
        scale = float(np.abs(moved).max()) if iteration == 1 else scale
        residual = error_pa / (stiffness * scale) if error_pa > 0 else 0.0
        if residual <= tolerance:
            box[:, touching] = new
            return box, shift, residual, iteration
        if float(np.vdot(new - ahead, new - traction)) < 0:
            momentum = 1.0
        following = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (momentum - 1) / following * (new - traction)
        traction, momentum = new, following
    finding = f"what sticks is wrong by {residual:.2g} of what moves after {most} iterations"
    raise SimulationError("shear", finding, "Allow more iterations or a larger tolerance.")


def _balanced(
    wanted: np.ndarray, limit: np.ndarray, total: np.ndarray, lift: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Tractions (2, n) within a limit (n,) and of a sum (2,) that are nearest to wanted ones.

    They are the wanted ones plus a lift (2,), cut to the limit: Newton's method on the convex function of the
    lift whose slope is what the sum is too much by. Also returns the lift.
    """
    cut, close = np.empty_like(wanted), 1e-9 * float(limit.sum())
    energy, *found = _cut(wanted, limit, total, lift, cut)
    for _ in range(BALANCE_STEPS):
        x, y, xx, xy, yy = found
        if max(abs(x), abs(y)) <= close:
            break
        xx, yy = xx + LEAST_SLOPE * len(limit), yy + LEAST_SLOPE * len(limit)
        step = np.array([yy * x - xy * y, xx * y - xy * x]) / (xx * yy - xy * xy)
        before = energy
        energy, *found = _cut(wanted, limit, total, lift - step, cut)
        while energy > before + 1e-12 * abs(before):
            step /= 2
            energy, *found = _cut(wanted, limit, total, lift - step, cut)
        lift = lift - step
    return cut, lift


@kernel
def _cut(wanted, limit, total, lift, cut):
    """Fill in the tractions that a lift gives: what it should make least, its slope (2), that one's (3)."""
    energy = -total[0] * lift[0] - total[1] * lift[1]
    x, y, xx, xy, yy = -total[0], -total[1], 0.0, 0.0, 0.0
    for i in range(len(limit)):
        a, b, most = wanted[0, i] + lift[0], wanted[1, i] + lift[1], limit[i]
        length = np.sqrt(a * a + b * b)
        share = 1.0
        if length <= most:
            energy += length * length / 2
            xx, yy = xx + 1, yy + 1
        else:
            energy += most * (length - most / 2)
            share = most / length
            c, d = a / length, b / length
            xx, xy, yy = xx + share * d * d, xy - share * c * d, yy + share * c * c
        cut[0, i], cut[1, i] = share * a, share * b
        x, y = x + share * a, y + share * b
    return energy, x, y, xx, xy, yy
