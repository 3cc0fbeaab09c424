"""What a simulator needs of one object: looks, collision shapes, mass, and contact."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import InputError
from objectfolder.export.files import Credit
from objectfolder.export.gltf import Part
from objectfolder.surface.convex_parts import ConvexParts
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RigidBody:
    """Mass and inertia of a rigid body.

    Parameters
    ----------
    mass_kg
        Kilograms.
    centre_of_mass_m
        (3,) metres, object frame.
    inertia_kg_m2
        (3, 3) about the centre of mass, axes of the object frame.

    Raises
    ------
    InputError
        Values that no body has: a mass that is not positive, an inertia that is not symmetric, not positive,
        or breaks the triangle inequality of its principal moments.

    Examples
    --------
    >>> ball = RigidBody(0.5, np.zeros(3), np.eye(3) * 2e-4)
    >>> moments, axes = ball.principal()
    >>> moments.tolist()
    [0.0002, 0.0002, 0.0002]
    """

    mass_kg: float
    centre_of_mass_m: Floats
    inertia_kg_m2: Floats

    def __post_init__(self) -> None:
        inertia = np.asarray(self.inertia_kg_m2, dtype=np.float64)
        values = [self.mass_kg, *np.ravel(self.centre_of_mass_m), *inertia.ravel()]
        if inertia.shape != (3, 3) or len(values) != 13 or not np.isfinite(values).all():
            raise InputError("body", "mass, centre or inertia are not finite numbers", "Check the solid.")
        if not self.mass_kg > 0:
            raise InputError("body", f"a mass of {self.mass_kg:g} kg", "It must be positive.")
        moments = np.linalg.eigvalsh((inertia + inertia.T) / 2)
        uneven = np.abs(inertia - inertia.T).max() > 1e-9 * np.abs(inertia).max()
        if uneven or moments[0] <= 0 or moments[2] > (moments[0] + moments[1]) * (1 + 1e-9):
            finding = f"principal moments {', '.join(f'{value:.4g}' for value in moments)} kg m2"
            raise InputError("body", f"{finding} are no body's", "Check that the mesh encloses a solid.")

    def principal(self) -> tuple[Floats, Floats]:
        """Return principal moments (3,), ascending, and their axes as columns of a rotation (3, 3)."""
        moments, axes = np.linalg.eigh(self.inertia_kg_m2)
        if np.linalg.det(axes) < 0:
            axes[:, 2] *= -1
        return moments, axes

    def of_mass(self, mass_kg: float) -> "RigidBody":
        """Return the same shape with another mass: the inertia follows."""
        return RigidBody(mass_kg, self.centre_of_mass_m, self.inertia_kg_m2 * (mass_kg / self.mass_kg))


@dataclass(frozen=True)
class Contact:
    """Dry contact of a material.

    Parameters
    ----------
    friction
        Coefficient of sliding friction, 0 or more. Simulators combine those of two bodies in different ways.
    restitution
        Speed after over speed before a collision, in 0..1.
    """

    friction: float
    restitution: float

    def __post_init__(self) -> None:
        if not (0 <= self.friction < float("inf") and 0 <= self.restitution <= 1):
            finding = f"friction {self.friction:g}, restitution {self.restitution:g}"
            raise InputError("contact", finding, "Friction is 0 or more, restitution in 0..1.")


@dataclass(frozen=True)
class Asset:
    """One object as simulators take it; all geometry in metres, object frame, z up.

    Parameters
    ----------
    name
        Of the object; letters, digits, ``_``, ``-`` and ``.``.
    visual
        Textured triangles.
    surface
        What bounds the solid, in one mesh: for simulators that collide by signed distance.
    appearance
        Roughness and metallic factors.
    collision
        Convex parts.
    body
        Mass and inertia.
    mass_of
        Whose the mass is, in words.
    contact
        Friction and restitution.
    credit
        Source, licence, attribution.
    """

    name: str
    visual: Sequence[Part]
    surface: Surface
    appearance: Appearance
    collision: ConvexParts
    body: RigidBody
    mass_of: str
    contact: Contact
    credit: Credit
