"""What light a surface of known material sends to the camera: `CompiledNetwork`, with nothing learned."""

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.network import Known, reflected_once
from objectfolder.vision.compiled.principled import LEAST_ROUGHNESS, Principled
from objectfolder.vision.compiled.radiosity import Radiosity
from objectfolder.vision.environment import Environment
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.material import Material


class KnownLight:
    """Light reflected once in closed form, and light that the surface sends onto itself by radiosity.

    Parameters
    ----------
    lit, surface
        The surface, for kernels and in its unit frame.
    material
        What it is made of.

    Attributes
    ----------
    alpha2
        Squared GGX width where no map gives another.

    Raises
    ------
    FormatError
        A material that is not known in full.
    """

    def __init__(self, lit: LitSurface, surface: UnitSurface, material: Material) -> None:
        appearance = material.appearance
        if appearance is None or not material.states("albedo"):
            raise FormatError("vision", "light of a material that is not stated", "Build it again.")
        self.alpha2 = np.float32(max(appearance.roughness, LEAST_ROUGHNESS) ** 4)
        self._surface, self._material = surface, material
        constant = () if material.mapped("roughness") else (appearance.roughness,)
        self._principled = Principled(appearance.specular, constant)
        matt = material.mapped("metallic") or appearance.metallic < 1
        self._radiosity = Radiosity(lit, surface, material) if matt else None

    def features(self, points: Points) -> Known:
        """Return the terms (n, `TERMS`) of points that no light changes, and albedo (n, 3), float32."""
        places = self._surface.in_stored(points.face, points.barycentric)
        base, roughness, metallic = (
            self._material.value(name, *places) for name in ("albedo", "roughness", "metallic")
        )
        return self._principled.terms(points, base, roughness, metallic), base.astype(np.float32)

    def bounced_by(
        self, points: Points, known: Known, irradiance: np.ndarray, light: np.ndarray
    ) -> np.ndarray:
        """Return what `CompiledNetwork.bounced_by` does."""
        terms, albedo = known
        if self._radiosity is None:
            return np.zeros_like(albedo)
        arriving = self._radiosity.from_lamp(light, points.face, points.barycentric)
        return np.asarray(albedo * terms[:, 2:3] * arriving, dtype=np.float32)

    def bounced_round(self, points: Points, terms: np.ndarray, around: Environment) -> np.ndarray:
        """Return the bounced light (n, 3) over the albedo of points in an environment."""
        if self._radiosity is None:
            return np.zeros((len(terms), 3))
        return terms[:, 2:3] * self._radiosity.from_environment(around, points.face, points.barycentric)

    def reflected(
        self, points: Points, features: np.ndarray, row: np.ndarray, to_light: np.ndarray, alpha2: np.float32
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what `CompiledNetwork.reflected` does; the terms say how wide the highlight is."""
        return self._principled.reflected(points, features, row, to_light)

    def directly(self, points: Points, known: Known, irradiance: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Return what `CompiledNetwork.directly` does."""
        return reflected_once(self, points, known, irradiance, light, self.alpha2)
