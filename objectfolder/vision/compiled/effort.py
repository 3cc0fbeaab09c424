"""What the number of sub-rays of an image buys."""

from dataclasses import dataclass

from objectfolder.errors import QueryError


@dataclass(frozen=True)
class Effort:
    """What `sub_rays` buys.

    Parameters
    ----------
    samples
        Sub-samples of visibility a pixel.
    samples_uneven
        The same where a smooth piece of surface ends.
    samples_outline
        The same where the pixel is covered in part, for its coverage alone.
    shaded
        Colours a smooth piece of surface in a pixel.
    shaded_uneven
        The same where colour changes fast.
    shaded_curved
        The same where normals turn within the pixel by much of the highlight's width, too (`TURNED`).
    shadow_rays
        Sub-samples that are asked for a pixel in which a shadow ends.
    contrast
        Difference to a neighbour, in sRGB, from which on it does.
    """

    samples: int
    samples_uneven: int
    samples_outline: int
    shaded: int
    shaded_uneven: int
    shaded_curved: int
    shadow_rays: int
    contrast: float

    @classmethod
    def of(cls, sub_rays: int) -> "Effort":
        """Return the effort of a number of sub-rays.

        Raises
        ------
        QueryError
            Fewer than one.
        """
        if sub_rays < 1:
            raise QueryError("sub_rays", f"{sub_rays} rays a pixel", "Use 1, 4, 16 or 64.")
        if sub_rays >= 64:
            return cls(16, 4 * sub_rays, max(1024, 4 * sub_rays), 4, 16, 64, 64, 0.03)
        if sub_rays >= 16:
            return cls(16, 256, 256, 1, 4, 4, 16, 0.02)
        if sub_rays >= 4:
            return cls(16, 64, 64, 1, 3, 3, 16, 0.05)
        return cls(16, 64, 64, 1, 1, 1, 8, 2.0)
