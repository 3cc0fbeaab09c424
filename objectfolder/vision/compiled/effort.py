"""What the number of sub-rays of an image buys."""

from dataclasses import dataclass

from objectfolder.errors import QueryError

# Points of a pixel of known material in which colour changes, by the least sub-rays that take that number.
# A pixel has at least that number of sub-samples of visibility.
POINTS_BY_SUB_RAYS = {128: 64, 64: 32}
LEARNED_POINTS = 16


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
    shaded_ends
        Of a known material, colours of a smooth piece of surface that ends in the pixel: each of them asks
        for its own shadow, and twice as many where light or colour changes among them. 0: as `shaded`.
    gloss
        Of a known material, rays that look for surface in gloss: 2 more where few meet any, 1 the few alone,
        0 these, but none where lobes are wide.
    coarse
        Of a known material, whether bounced light is that of few points a site.
    """

    samples: int
    samples_uneven: int
    samples_outline: int
    shaded: int
    shaded_uneven: int
    shaded_curved: int
    shadow_rays: int
    contrast: float
    shaded_ends: int = 0
    gloss: int = 2
    coarse: bool = False

    @classmethod
    def of(cls, sub_rays: int, *, is_known: bool = False, one_lamp: bool = False) -> "Effort":
        """Return the effort of a number of sub-rays, by a network or on a known material, of one lamp or not.

        Raises
        ------
        QueryError
            Fewer than one.
        """
        if sub_rays < 1:
            raise QueryError("sub_rays", f"{sub_rays} rays a pixel", "Use 1, 2, 4, 16, 64 or 128.")
        if sub_rays >= 64:
            points = next(count for least, count in POINTS_BY_SUB_RAYS.items() if sub_rays >= least)
            points = points if is_known else LEARNED_POINTS
            return cls(points, 4 * sub_rays, max(1024, 4 * sub_rays), 4, points, 64, 64, 0.03, 12)
        one_lamp = one_lamp and is_known
        if one_lamp and sub_rays >= 16:
            return cls(16, 64, 256, 1, 16, 16, 16, 0.03, gloss=1, coarse=True)
        if one_lamp and sub_rays >= 4:
            return cls(16, 64, 256, 1, 16, 16, 16, 0.03, gloss=0, coarse=True)
        if one_lamp and sub_rays >= 2:
            return cls(16, 64, 64, 1, 9, 9, 8, 0.15, gloss=0, coarse=True)
        if sub_rays >= 16:
            return cls(16, 256, 256, 1, 4, 4, 16, 0.02, gloss=1)
        if sub_rays >= 4:
            return cls(16, 64, 64, 1, 3, 3, 16, 0.05, gloss=1)
        # One colour a piece whatever the lamps: images of lamps add up.
        return cls(16, 64, 64, 1, 1, 1, 8, 2.0, gloss=1)
