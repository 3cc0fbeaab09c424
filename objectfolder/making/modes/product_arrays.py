"""What a product of modes says of a spectrum: arrays of (mode,), and attributes of all modes together."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.making.damping import LossFactor, Rayleigh
from objectfolder.making.materials import Material
from objectfolder.making.modes.spectrum import Spectrum
from objectfolder.making.solid.solid import Solid
from objectfolder.products.store import Array

Floats = NDArray[np.float64]
# Worst true error of a body's modes over the worst that is stated: on nine bodies .28 to .49.
WORST_OF_STATED = 0.5


@dataclass(frozen=True)
class Units:
    """What 1 stands for in the dimensionless problem of a solid."""

    length_m: float
    radians_per_s: float  # omega = eta c_s / L
    mass_kg: float

    @classmethod
    def of(cls, solid: Solid, material: Material) -> "Units":
        """Return the units of a solid of a material."""
        length = float(np.ptp(solid.vertices, axis=0).max())
        return cls(length, material.shear_speed_m_s / length, material.density_kg_m3 * length**3)


@dataclass(frozen=True)
class Motion:
    """How modes move in time.

    Attributes
    ----------
    eigenvalues : (modes,) rad^2/s^2
    material_dampings_per_s : (modes,) decay rates that the material's law gives
    radiation_dampings_per_s : (modes,) what radiation adds, None where it is not solved
    """

    eigenvalues: Floats
    material_dampings_per_s: Floats
    radiation_dampings_per_s: Floats | None = None

    @classmethod
    def of(cls, spectrum: Spectrum, damping: LossFactor | Rayleigh, units: Units) -> "Motion":
        """Return the motion of a spectrum's modes in a vacuum."""
        eigenvalues = spectrum.eta_squared * units.radians_per_s**2
        return cls(eigenvalues, damping.decay_rates(eigenvalues))

    @property
    def dampings_per_s(self) -> Floats:
        """Decay rates (modes,) of the amplitudes."""
        if self.radiation_dampings_per_s is None:
            return self.material_dampings_per_s
        return self.material_dampings_per_s + self.radiation_dampings_per_s

    @property
    def frequencies_hz(self) -> Floats:
        """Damped frequencies (modes,): sqrt(lambda - c^2) / 2 pi, and 0 where a mode does not ring."""
        return np.sqrt(np.maximum(self.eigenvalues - self.dampings_per_s**2, 0)) / (2 * np.pi)


def shape_arrays(points: Floats, normals: Floats, shapes: Floats, training: int) -> dict[str, Array]:
    """Points (point, 3), the first for training, with normals and mode shapes (point, 3, mode) there."""
    return {
        "points": Array(points, ("point", "axis"), "m", "points of the surface, object frame", False),
        "normals": Array(normals, ("point", "axis"), "1", "outward normals there, object frame", False),
        "mode_shapes": Array(
            shapes.astype(np.float32),
            ("point", "axis", "mode"),
            "kg-1/2",
            "mode shape, u^T M u = 1",
            False,
        ),
        "held_out": Array(np.arange(len(points)) >= training, ("point",), "1", "point is not for fitting"),
    }


def spectrum_arrays(spectrum: Spectrum, motion: Motion, weights: Floats) -> dict[str, Array]:
    """What the product says of each mode; error estimates are NaN where nothing is known."""
    eigenvalues = motion.eigenvalues
    errors = spectrum.error_cents if len(spectrum.error_cents) else np.full(len(eigenvalues), np.nan)
    arrays = {
        "frequencies_hz": Array(
            motion.frequencies_hz, ("mode",), "Hz", "damped eigenfrequency, 0 if it does not ring"
        ),
        "eigenvalues": Array(eigenvalues, ("mode",), "rad2 s-2", "squared angular eigenfrequency"),
        "dampings_per_s": Array(motion.dampings_per_s, ("mode",), "s-1", "decay rate of the amplitude"),
        "residuals": Array(spectrum.residuals, ("mode",), "1", "|K u - lambda M u| / |lambda M u|"),
        "error_estimates_cents": Array(errors, ("mode",), "cents", "estimated error of the frequency"),
        "radiation_weights": Array(
            weights, ("mode",), "kg-1/2", "rms over the surface of the normal component"
        ),
    }
    if motion.radiation_dampings_per_s is not None:
        arrays["radiation_dampings_per_s"] = Array(
            motion.radiation_dampings_per_s, ("mode",), "s-1", "what radiation has of the decay rate"
        )
    return arrays


def spectrum_attributes(
    spectrum: Spectrum, units: Units, frequencies: Floats, accuracy_cents: float, shape: Mapping[str, Any]
) -> dict[str, Any]:
    """What the product says of the modes together; `shape` as of `solid.comparison.shape_attributes`."""
    limit_hz = float(np.sqrt(spectrum.limit) * units.radians_per_s / (2 * np.pi))
    geometry_cents = shape["geometry_error_estimate_cents"]
    accuracy = accuracy_attributes(accuracy_cents, spectrum.error_cents, geometry_cents)
    near = near_limit(spectrum, geometry_cents)
    return {
        "audible": len(frequencies) > 0,
        "stated_frequency_limit_hz": limit_hz,
        "overdamped_modes": int(np.count_nonzero(frequencies == 0)),
        "count_certificate": {**spectrum.certificate, "limit_hz": limit_hz, **near},
        "error_estimate_cents": float(spectrum.error_cents.max()) if len(spectrum.error_cents) else None,
        "rigid_frequency_hz": float(np.sqrt(spectrum.rigid_eta_squared) * units.radians_per_s / (2 * np.pi)),
        "geometry_error_estimate_cents": geometry_cents,
        **accuracy,
        "warnings": [*accuracy["warnings"], *shape["warnings"]],
    }


def near_limit(spectrum: Spectrum, geometry_cents: float | None) -> dict[str, int]:
    """How many modes lie so near the limit that the body itself may have them on its other side.

    The elements have every frequency too high, by up to its estimate, and of another shape, by the geometry's
    error up or down: a mode found below the limit is above it by the shape alone. Those found above the limit
    have the estimate of the last mode below it.
    """
    shape = geometry_cents or 0.0
    elements = float(spectrum.error_cents[-1]) if len(spectrum.error_cents) else 0.0
    cents_below = 600 * np.log2(spectrum.limit / spectrum.eta_squared)
    cents_above = 600 * np.log2(spectrum.beyond / spectrum.limit)
    return {
        "found_within_error_below_limit": int(np.count_nonzero(cents_below <= shape)),
        "left_within_error_above_limit": int(np.count_nonzero(cents_above <= elements + shape)),
    }


def accuracy_attributes(
    accuracy_cents: float, error_cents: Floats, geometry_cents: float | None
) -> dict[str, Any]:
    """What was asked, whether it was reached (None without modes), and what to say where it was not.

    What is stated covers nearly every mode, so that most are nearer: of a body's modes the worst is off by
    `WORST_OF_STATED` of the worst that is stated. By that it is judged whether the wish was reached.
    """
    stated = error_cents + (geometry_cents or 0.0)
    above = int(np.count_nonzero(stated > accuracy_cents))
    reached = bool((WORST_OF_STATED * stated <= accuracy_cents).all())
    text = (
        f"{accuracy_cents:g} cents wanted (accuracy_cents), {stated.max(initial=0.0):.1f} may be left "
        f"in {above} of {len(stated)} modes: it takes more elements, or state a larger accuracy_cents"
    )
    return {
        "accuracy_cents": float(accuracy_cents),
        "accuracy_reached": reached if len(stated) else None,
        "warnings": [] if reached else [text],
    }
