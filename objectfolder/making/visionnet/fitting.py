"""Fit a VisionNet to views: how many rays of how many pixels the object is worth, and a network of these."""

import numpy as np

from objectfolder.errors import InputError
from objectfolder.products.store import Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.material import Material
from objectfolder.vision.network.sparse_grid import SparseGrid, covering_points
from objectfolder.vision.network.surface_maps import SurfaceMaps
from objectfolder.vision.visionnet.visionnet import VisionNet

MATERIALS = "known", "learned"
# Roughness up to which a conductor's mirror rays pay: a metal teapot of 0.25 gains 5.8 dB for 1.6 times the
# time. Up to the second they pay where the surface fills this share of its own view (`filled_view`): a rack
# of wire and a chain of 0.4 gain 2.7 and 2.8 dB for 1.6 and 1.4 times the time. A spoon sees less of itself.
SMOOTH, MOST_ROUGHNESS = 0.3, 0.4
FILLED_SHARE = 0.2
FILLED_RAYS = 4000
# Looks at a pixel in the course of training beyond which more rays a look are worth more than more looks.
ENOUGH_LOOKS = 5
# Rays through a training pixel, at least and at most.
FEW_RAYS, MOST_TRAINING_RAYS = 4, 24
# Of thin objects: rays for each share of covered pixels that are outline, above what a solid body has.
RAYS_OF_OUTLINE, OUTLINE_OF_SOLID = 100, 0.1


def fit_visionnet(
    surface: Surface, frame: UnitFrame, views: Product, *, steps: int = 1200, batch_pixels: int = 1024,
    training_sub_rays: int | None = None, training_pixels: int = 600_000, learning_rate: float = 1e-2,
    grid_corners: int = 100_000, grid_resolution: int = 128, mirrors: bool | None = None,
    base_colour_weight: float = 0.3, evenness_weight: float = 1e-3, maps: SurfaceMaps | None = None,
    material: str = "learned", seed: int = 0,
) -> VisionNet:  # fmt: skip
    """Fit a VisionNet to the views that are not held out.

    Equal arguments give equal weights on the same number of torch threads.

    Parameters
    ----------
    surface, frame
        The decoded surface that the Object File will hold, and its unit frame.
    views
        Product of `views.simulate_views`.
    steps, batch_pixels, learning_rate
        Steps of Adam, pixels a step (of 4 rays; fewer pixels of more rays), and its rate.
    training_sub_rays, training_pixels
        Rays through each training pixel, and how many pixels (of 4 rays, as above) to choose from all
        training views at most. If None 4 rays, more where the pixels are few (`rays_to_average`),
        highlights narrow (`rays_to_meet`) or parts thin (`rays_to_resolve`).
    grid_corners, grid_resolution
        At most this many corners at the finest level, and at most this many cells a side (a multiple of 8).
    mirrors
        Whether the network shows the surface in itself, at the cost of one more ray a point; if None,
        where `shows_itself` says so.
    base_colour_weight, evenness_weight
        How much the albedo is held to the views' base-colour pass, and the reflectance over it to be alike
        all over, see `training.Priors`; 0 not at all. Views without that pass are fitted without the first.
    maps
        What the source has of normals, holes, roughness and metallic on the surface's faces.
    material
        ``"learned"``; or ``"known"``: where maps state an albedo nothing is fitted, and light is computed
        from albedo, roughness and metallic. A surface without such a map is learned: `VisionNet.computed`.
    seed
        Of initial weights, batches and rays.

    Raises
    ------
    InputError
        No training view shows the object; another word for a material; thin glass that would be learned.
    """
    appearance = Appearance(**views.attributes["appearance"])
    scale = float(views.attributes["light_power_w"]) / (4 * np.pi**2)
    radius = float(views.attributes["camera_radius"])
    if material not in MATERIALS:
        raise InputError("visionnet.material", repr(material), f"Use one of {', '.join(MATERIALS)}.")
    if material == "known" and Material(maps, appearance).states("albedo"):
        return VisionNet(surface, frame, None, {}, radiance_scale=scale, camera_radius=radius,
                         maps=maps, appearance=appearance)  # fmt: skip
    if appearance.thin:
        finding = "thin glass cannot be learned"
        if material == "known":
            finding = "the lattice of base colours has no room for the faces of this thin glass"
        raise InputError("visionnet.material", finding, "Use known, a mesh of fewer faces, or opaque glass.")
    # Importing torch takes as long as encoding a small object of known material.
    from objectfolder.making.visionnet.training import Priors, trace_training_rays, train

    mirrors = shows_itself(appearance, surface) if mirrors is None else mirrors
    if training_sub_rays is None:
        alpha = views["rgba"][~views["held_out"]][..., 3]
        covered, partly = int(np.count_nonzero(alpha)), int(np.count_nonzero((alpha > 0) & (alpha < 1)))
        training_sub_rays = max(
            rays_to_average(covered, steps * batch_pixels * FEW_RAYS),
            rays_to_meet(appearance, mirrors),
            rays_to_resolve(partly / max(covered, 1)),
        )
    # More rays a pixel cost fewer pixels: memory and time stay.
    share = min(1.0, FEW_RAYS / training_sub_rays)
    shown = UnitSurface(surface, frame, maps)
    rays = trace_training_rays(shown, views, training_sub_rays,
                               int(training_pixels * share), seed, mirrors=mirrors)  # fmt: skip
    points = covering_points(shown.surface, frame.to_unit(shown.surface.vertices), grid_resolution)
    grid = SparseGrid.within_budget(np.concatenate([points, rays.position]), grid_corners, grid_resolution)
    network = train(grid, rays, radiance_scale=scale, steps=steps,
                    batch_pixels=max(1, int(batch_pixels * share)), learning_rate=learning_rate, seed=seed,
                    priors=Priors(base_colour_weight, evenness_weight))  # fmt: skip
    weights = {name: value.numpy().astype(np.float16) for name, value in network.state_dict().items()}
    return VisionNet(surface, frame, grid, weights, radiance_scale=scale, camera_radius=radius,
                     maps=maps, appearance=appearance)  # fmt: skip


def shows_itself(appearance: Appearance, surface: Surface) -> bool:
    """Whether one mirror ray a point pays: a conductor that is smooth, or less so and faces itself."""
    if appearance.metallic < 0.5 or appearance.roughness > MOST_ROUGHNESS:
        return False
    return appearance.roughness <= SMOOTH or filled_view(surface) >= FILLED_SHARE


def filled_view(surface: Surface) -> float:
    """Return which share of what the points of a surface face it fills itself, weighted by cosine; 0 to 1.

    It is 0 for a convex solid.
    """
    samples = surface.sample(FILLED_RAYS, seed=0)
    normals = surface.face_normals[samples.face]
    directions = np.random.default_rng(0).normal(size=normals.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # A point of a sphere that touches the plane is seen as often as the cosine of its direction says.
    directions += 1.000001 * normals
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    lifted = samples.points + 1e-4 * np.ptp(surface.bounds, axis=0).max() * normals
    return float((surface.ray_hits(lifted, directions).face >= 0).mean())


def rays_to_meet(appearance: Appearance, mirrors: bool) -> int:
    """Return how many rays through a training pixel a highlight asks for, more where it is all that is seen.

    With 4 rays a narrow highlight is met by chance, and the fit flattens it. At equal cost a metal teapot
    of roughness 0.25 with mirrors gains 1.7 dB by 12 rays in place of 4. Without mirrors a glazed plate
    of 0.2 gains 1.6 dB by 10 and as much again by 24, glass marbles of 0.2 0.9 dB by 24 in place of 10, a
    bowl of 0.3 0.3 dB by 7; with 10 its texture, looked at less often, loses as much. A chair of 0.5
    gains by 6, a painted cabinet of 0.7 loses 0.5 dB.
    """
    roughness = max(appearance.roughness, 1e-3)
    wanted = 3.0 / roughness if mirrors else max(0.19 / roughness**3, min(3.0 / roughness, 6.0))
    return int(np.clip(round(wanted), FEW_RAYS, MOST_TRAINING_RAYS))


def rays_to_average(pixels: int, rays: int) -> int:
    """Return how many rays a look at each of `pixels` is worth, where training follows `rays` in all.

    A pixel's colour is the mean over its area, and a few rays through it a noisy guess of what that holds:
    at edges the fit is to the noise. An object with few pixels is looked at often enough to afford more
    at equal cost: a pair of scissors gains 6 dB by 12 or 24 rays in place of 4.
    """
    return int(np.clip(rays // (ENOUGH_LOOKS * max(pixels, 1)), FEW_RAYS, MOST_TRAINING_RAYS))


def rays_to_resolve(outline: float) -> int:
    """Return how many rays through a training pixel thin parts ask for.

    They turn, end and are lit in part within a pixel. At equal cost a chain (`outline` .53) gains 2.8 dB of
    other views by 64 rays in place of 24, a wire rack (.51) 3.4 dB by 40 in place of 8.

    Parameters
    ----------
    outline
        Share of the pixels that show the object which it covers in part, 0 to 1.
    """
    return max(FEW_RAYS, round(RAYS_OF_OUTLINE * (outline - OUTLINE_OF_SOLID)))
