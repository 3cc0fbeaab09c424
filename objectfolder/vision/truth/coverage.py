"""How much of a pixel the object covers, by many rays: the renderer's own share is the noise of silhouettes.

At 256 paths nine tenths of the squared error of a bell of metal lie in the alpha of its outline.
"""

import numpy as np

from objectfolder.surface.surface import Surface
from objectfolder.vision.cameras import pixel_rays, sub_ray_offsets
from objectfolder.vision.truth.render_request import Scene

# Two casts of a chain and a clamp agree within 56 dB at their outlines; 256 paths have 45.
COVERAGE_RAYS = 1024
# Pixels cast at a time: 100 MB.
PIXELS_AT_ONCE = 512


def with_cast_coverage(
    scene: Scene, rgba: np.ndarray, camera_to_world: np.ndarray, seeds: np.ndarray, field_of_view_deg: float
) -> np.ndarray:
    """Return rendered views with the alpha of pixels that the object covers in part cast anew.

    The straight colour of a pixel stays. A texture's alpha is the renderer's to judge, so a scene with
    holes, or of thin glass, stays as it is.

    Parameters
    ----------
    scene
        What was rendered.
    rgba
        (n, h, w, 4) premultiplied.
    camera_to_world, field_of_view_deg
        (n, 4, 4) poses in the unit frame, and the angle over the longer side.
    seeds
        (n,) of the lattices of rays: equal views with other seeds are cast independently.
    """
    if scene.lets_through:
        return rgba
    surface, offsets = Surface(scene.vertices, scene.faces), sub_ray_offsets(COVERAGE_RAYS)
    height, width = rgba.shape[1:3]
    result = rgba.copy()
    for view, pose in enumerate(camera_to_world):
        random = np.random.default_rng(int(seeds[view]))
        pixels = result[view].reshape(-1, 4)
        partly = np.flatnonzero((pixels[:, 3] > 0) & (pixels[:, 3] < 1))
        for places in np.split(partly, range(PIXELS_AT_ONCE, len(partly), PIXELS_AT_ONCE)):
            shifted = (offsets + random.random((len(places), 1, 2))) % 1.0
            hits = surface.ray_hits(*pixel_rays(pose, places, shifted, (height, width), field_of_view_deg))
            alpha = (hits.face >= 0).reshape(-1, COVERAGE_RAYS).mean(axis=1)
            rendered = pixels[places].astype(np.float64)
            # What no ray meets is thinner than the rays are apart: the renderer's share is all that is known.
            alpha = np.where(alpha > 0, alpha, rendered[:, 3])
            pixels[places] = rendered * (alpha / rendered[:, 3])[:, None]
    return result
