"""How a surface reflects light besides its base colour."""

from dataclasses import dataclass
from typing import Any

from objectfolder.errors import InputError


@dataclass(frozen=True)
class Appearance:
    """Reflectance of an opaque surface: the principled model of Burley (2012), as Cycles has it.

    Parameters
    ----------
    roughness
        Square root of the GGX width alpha: 0 a mirror, 1 matt.
    metallic
        0 a dielectric (diffuse base under a clear coat of index 1.5), 1 a conductor.
    specular
        Level of the dielectric reflection: 0 none (Lambert), 0.5 an index of 1.5.

    Raises
    ------
    InputError
        A value outside [0, 1].
    """

    roughness: float = 0.5
    metallic: float = 0.0
    specular: float = 0.5

    def __post_init__(self) -> None:
        for name in ("roughness", "metallic", "specular"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"appearance.{name}", f"{value} is outside [0, 1]", "Give a fraction.")

    def to_dict(self) -> dict[str, Any]:
        """Return the appearance as JSON."""
        return {"roughness": self.roughness, "metallic": self.metallic, "specular": self.specular}
