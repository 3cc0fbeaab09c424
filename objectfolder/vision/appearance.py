"""How a surface reflects light, or lets it through, besides its base colour."""

from dataclasses import dataclass
from typing import Any

from objectfolder.errors import InputError

OPAQUE, THIN = "opaque", "thin"
GLASSES = OPAQUE, THIN


@dataclass(frozen=True)
class Appearance:
    """Reflectance of a surface: the principled model of Burley (2012) as Cycles has it, or thin glass.

    Parameters
    ----------
    roughness
        Square root of the GGX width alpha: 0 a mirror, 1 matt.
    metallic
        0 a dielectric (diffuse base under a clear coat of index 1.5), 1 a conductor.
    specular
        Level of the dielectric reflection: 0 none (Lambert), 0.5 an index of 1.5.
    glass
        ``"opaque"``, or ``"thin"``: each wall between the outside and the outside again is a slab of glass
        (`network.thin_glass`), and the base colour is what one passage through it lets through.

    Raises
    ------
    InputError
        A value outside [0, 1], another word for glass, or thin glass of metal.
    """

    roughness: float = 0.5
    metallic: float = 0.0
    specular: float = 0.5
    glass: str = OPAQUE

    def __post_init__(self) -> None:
        for name in ("roughness", "metallic", "specular"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"appearance.{name}", f"{value} is outside [0, 1]", "Give a fraction.")
        check_glass(self.glass, "appearance.glass")
        if self.thin and self.metallic > 0:
            raise InputError(
                "appearance.glass", "is thin, of a metal", "Set metallic to 0, or glass to opaque."
            )

    @property
    def thin(self) -> bool:
        """Whether light passes through its walls."""
        return self.glass == THIN

    def to_dict(self) -> dict[str, Any]:
        """Return the appearance as JSON, which names `glass` where it is not opaque."""
        stated = {"roughness": self.roughness, "metallic": self.metallic, "specular": self.specular}
        return {**stated, "glass": self.glass} if self.thin else stated


def check_glass(glass: str, where: str) -> None:
    """Raise `InputError` for a word that is none of `GLASSES`."""
    if glass not in GLASSES:
        raise InputError(where, f"{glass!r} is not known", f"Use one of {', '.join(GLASSES)}.")
