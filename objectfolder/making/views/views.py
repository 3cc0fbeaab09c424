"""The ground truth of sight: path-traced views of an object under a moving point light."""

from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.making.views.conditions import render_conditions
from objectfolder.making.views.cycles_process import render_series
from objectfolder.making.views.glass import with_alpha_apart
from objectfolder.making.views.passes import Passes, cast_passes, with_cast_coverage
from objectfolder.making.views.render_request import (
    BOUNCES,
    NOISE_THRESHOLD,
    Scene,
    Shots,
    unit_scene,
)
from objectfolder.products.store import Array, Product
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import (
    CAMERA_RADIUS,
    FIELD_OF_VIEW_DEG,
    LIGHT_RADIUS,
    focal_length_px,
    image_size,
    look_at,
    uniform_on_sphere,
)
from objectfolder.vision.compositing import composite_on_white
from objectfolder.vision.lamps import LIGHT_POWER_W

# A held-out view is the mean of two renders, whose difference is its noise. A pixel of each gets this share
# of its samples at least, and this multiple while Cycles finds more noise than two renders may each have.
LEAST_SHARE, MOST_SHARE, HELD_OUT_THRESHOLD = 1 / 4, 4, NOISE_THRESHOLD * 2**0.5
# Seeds are below 2^30; this bit makes the seed of the second render.
SECOND_SEED = 1 << 30
NOISE_FLOOR = (
    "PSNR on white of the held-out views against the noise-free image: 6.02 dB above the PSNR between the "
    "two renders with independent seeds of which each is the mean, squared errors of all views pooled; "
    "foreground: over pixels that the object covers in part or whole"
)

TRANSMISSION = (
    "none: glass and other clear materials are drawn as glossy opaque surfaces, for caustics of a point "
    "light cannot be path traced; light passes only through holes (alpha)"
)
THIN_TRANSMISSION = (
    "thin walls: a ray that meets one from outside is reflected and absorbed as by a slab with two faces, "
    "and the rest goes straight on, as do shadow rays; nothing is refracted, and alpha is what is kept"
)
# Share of the covered pixels above which clipping is worth a warning.
CLIPPED_SHARE = 0.01
CLIPPED = (
    "share of the pixels covered in the held-out views (in all, where none are held out) whose straight "
    "colour exceeds 1 in a channel"
)

# Camera poses (n, 4, 4), light positions (n, 3) and path seeds (n,).
Drawn = tuple[np.ndarray, np.ndarray, np.ndarray]


def simulate_views(
    mesh: TexturedMesh, appearance: Appearance, *, resolution: int | tuple[int, int],
    training_views: int, training_samples: int, held_out_views: int, held_out_samples: int,
    field_of_view_deg: float = FIELD_OF_VIEW_DEG, camera_radius: float = CAMERA_RADIUS,
    light_power_w: float = LIGHT_POWER_W, condition_views: int = 0, seed: int = 0, threads: int = 1,
    passes: bool = True,
) -> Product:  # fmt: skip
    """Render an object from cameras uniform on a sphere, each with a light uniform on the unit sphere.

    Equal arguments give equal bytes, whatever `threads`. Training views do not depend on the number of
    held-out views, nor these on that of training views.

    Parameters
    ----------
    mesh, appearance
        The object, metres, rendered in its unit frame; and its reflectance besides the base colour.
    resolution, field_of_view_deg
        Pixels a side, or (height, width); and the angle over the longer side.
    training_views, held_out_views, training_samples, held_out_samples
        How many views of each kind, the held-out ones last; and paths a pixel. A held-out pixel gets half of
        these to eight times as many, as noisy as it is; exactly these, but for an odd one more, in scenes
        with holes.
    camera_radius, light_power_w
        Distance of the cameras from the origin, and radiant power of the point light for distances, in the
        unit frame.
    condition_views
        Views in each of `conditions.CONDITIONS`: finer images, other distances of the lamp, environments.
    seed, threads
        Of cameras, lights and paths; and render threads.
    passes
        False leaves out depth, normal, albedo, roughness, metallic and mask, which compress to several times
        the size of the images and can be cast again at any time (`passes.cast_passes`).

    Returns
    -------
    Product
        Arrays as of `_arrays` and `_pass_arrays`. Attributes say how it was made, how much noise it has, and
        in ``warnings`` what is wrong with it.

    Raises
    ------
    InputError
        A count or size that is not positive; thin glass whose surface is open.
    SimulationError
        Blender is missing or failed.

    Examples
    --------
    >>> from pathlib import Path
    >>> from objectfolder.making import load_mesh
    >>> from objectfolder.vision.appearance import Appearance
    >>> bar = load_mesh(Path("bar.obj"))
    >>> counts = {"training_views": 1, "training_samples": 1, "held_out_views": 0, "held_out_samples": 1}
    >>> views = simulate_views(bar, Appearance(0.4, 0.0), resolution=16, **counts)
    >>> views["rgba"].shape, views["camera_to_world"].shape
    ((1, 16, 16, 4), (1, 4, 4))
    """
    size = image_size(resolution)
    _require_positive(training_views=training_views, training_samples=training_samples,
                      held_out_samples=held_out_samples, camera_radius=camera_radius,
                      light_power_w=light_power_w)  # fmt: skip
    for name, count in (("held_out_views", held_out_views), ("condition_views", condition_views)):
        if count < 0:
            raise InputError(f"views.{name}", f"{count} is negative", "Give 0 or more.")
    if appearance.thin:
        _require_closed(mesh)
    frame = UnitFrame.of_points(mesh.vertices[np.unique(mesh.faces)])
    scene = unit_scene(mesh, appearance, frame)
    *streams, other = np.random.SeedSequence(seed).spawn(3)
    counts = training_views, held_out_views
    training, held_out = (_draw(*part, camera_radius) for part in zip(streams, counts, strict=True))
    how = (*size, field_of_view_deg, light_power_w, BOUNCES, threads)
    rgba, floors = _rendered(scene, training, held_out, (training_samples, held_out_samples), how)
    draws, is_held_out = _joined(training, held_out), np.arange(len(rgba)) >= training_views
    arrays = _arrays(
        rgba, draws, is_held_out, np.where(is_held_out, held_out_samples, training_samples).astype(np.int32)
    )
    if passes:
        arrays |= _pass_arrays(cast_passes(scene, draws[0], size, field_of_view_deg))
    elsewhere, conditions = render_conditions(
        scene, condition_views, held_out_samples, other, camera_radius, field_of_view_deg, light_power_w,
        threads,
    )  # fmt: skip
    arrays |= elsewhere
    attributes = {"camera_radius": float(camera_radius), "frame": frame.to_dict(), "seed": seed, **floors}
    attributes |= conditions
    exposed = exposure(rgba[is_held_out] if held_out_views else rgba)
    return Product(
        arrays, _attributes(scene, mesh, size, field_of_view_deg, light_power_w) | attributes | exposed
    )


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if value <= 0:
            raise InputError(f"views.{name}", f"{value} is not positive", "Give a positive number.")


def _require_closed(mesh: TexturedMesh) -> None:
    """Refuse an open surface: a wall of glass lies between the face that a ray enters and another."""
    if mesh.surface.edges.imbalance.any():
        finding = "the surface is open, so that no wall of glass can be told from its inside"
        raise InputError(
            "appearance.glass", finding, "Close the mesh, give sheets two sides, or draw it opaque."
        )


def _rendered(
    scene: Scene, training: Drawn, held_out: Drawn, samples: tuple[int, int], how: tuple[Any, ...]
) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the images of training and held-out views, and the noise attributes; `how` ends `Shots`."""
    shots = _held_out_shots(scene, held_out, samples[1], how)
    rendered, trained = render_series(scene, [shots, Shots(*training, samples[0], *how)])
    if scene.lets_through:
        rendered = with_alpha_apart(scene, [rendered], [shots])[0]
    else:
        # Cycles ends a pixel by the noise of its colour and knows nothing of that of its alpha.
        rendered = with_cast_coverage(
            scene, rendered, shots.camera_to_world, shots.seeds, shots.field_of_view_deg
        )
    first, second = np.split(rendered, 2)
    mean = ((first.astype(np.float32) + second) / 2).astype(np.float16)
    return np.concatenate([trained, mean]), noise_floor(first, second)


def _held_out_shots(scene: Scene, draws: Drawn, samples: int, how: tuple[Any, ...]) -> Shots:
    """Return each view twice, with independent seeds, and with more paths where a pixel is noisy."""
    cameras, lights, seeds = draws
    twice = _joined(draws, (cameras, lights, seeds ^ SECOND_SEED))
    if scene.lets_through:
        return Shots(*twice, -(-samples // 2), *how)
    least, most = max(1, int(LEAST_SHARE * samples)), MOST_SHARE * samples
    return replace(Shots(*twice, least, *how), most_samples=most, noise_threshold=HELD_OUT_THRESHOLD)


def _arrays(rgba: np.ndarray, draws: Drawn, is_held_out: np.ndarray, samples: np.ndarray) -> dict[str, Array]:
    """Return what every product of views has; ``rgba`` is averaged over each pixel."""
    cameras, lights, seeds = draws
    colour = "scene-linear premultiplied RGBA radiance"
    pose = "camera pose in the unit frame, OpenGL convention"
    return {
        "rgba": Array(rgba, ("view", "y", "x", "channel"), "1", colour),
        "camera_to_world": Array(cameras, ("view", "row", "column"), "1", pose),
        "light_position": Array(lights, ("view", "axis"), "1", "point light in the unit frame"),
        "held_out": Array(is_held_out, ("view",), "1", "kept from training"),
        "samples": Array(
            samples,
            ("view",),
            "1",
            "paths a pixel; held-out views, without holes: half of them to eight times",
        ),
        "seed": Array(seeds, ("view",), "1", "seed of the path sampler"),
    }


def _attributes(
    scene: Scene, mesh: TexturedMesh, size: tuple[int, int], field_of_view_deg: float, light_power_w: float
) -> dict[str, Any]:
    """Return how the views of a scene are made."""
    return {
        "field_of_view_deg": float(field_of_view_deg),
        "focal_length_px": focal_length_px(size, field_of_view_deg),
        "light_radius": LIGHT_RADIUS,
        "light_power_w": float(light_power_w),
        "bounces": BOUNCES,
        "appearance": scene.appearance.to_dict(),
        "background": "none: alpha 0; on white by compositing.on_white",
        "pixel_filter": "box of one pixel",
        "renderer": _renderer(),
        "transmission": THIN_TRANSMISSION if scene.appearance.thin else TRANSMISSION,
        "maps": {
            "roughness": len(mesh.roughness_maps),
            "metallic": len(mesh.metallic_maps),
            "normal": len(mesh.normal_maps),
            "holes": scene.has_holes,
        },
    }


def _pass_arrays(passes: Passes) -> dict[str, Array]:
    """Return what is at the centre of each pixel, see `passes.Passes`."""
    image = ("view", "y", "x")
    depth = "depth along the camera's -z axis at the pixel's centre"
    normal = "shading normal at the pixel's centre, unit frame"
    albedo = "scene-linear base colour at the pixel's centre"
    return {
        "depth": Array(passes.depth, image, "1", depth),
        "normal": Array(passes.normal, (*image, "axis"), "1", normal),
        "albedo": Array(passes.albedo, (*image, "channel"), "1", albedo),
        "roughness": Array(passes.roughness, image, "1", "roughness at the pixel's centre, 0 a mirror"),
        "metallic": Array(passes.metallic, image, "1", "at the pixel's centre, 0 a dielectric, 1 a metal"),
        "mask": Array(passes.mask, image, "1", "the pixel's centre shows the object"),
    }


def _draw(stream: np.random.SeedSequence, count: int, radius: float) -> Drawn:
    camera, light, path = (np.random.default_rng(child) for child in stream.spawn(3))
    poses = look_at(uniform_on_sphere(count, radius, camera)).reshape(-1, 4, 4)
    return (
        poses,
        uniform_on_sphere(count, LIGHT_RADIUS, light),
        path.integers(0, 2**30, count, dtype=np.int32),
    )


def _joined(first: Drawn, second: Drawn) -> Drawn:
    cameras, lights, seeds = (np.concatenate(pair) for pair in zip(first, second, strict=True))
    return cameras, lights, seeds


def noise_floor(first: np.ndarray, second: np.ndarray) -> dict[str, Any]:
    """Return the noise attributes of the means of two renders (n, h, w, 4) with independent seeds.

    The squared difference of two independent renders is in mean four times that of their mean and the truth,
    but for what both have wrong alike: noise that the sRGB encoding turns into darker means. Two views of a
    mug (128 x 128, 256 samples) store 57.4 dB of the foreground where their mean has 56.5 against the mean of
    16 other renders. With fewer held-out samples, where the encoding's bias counts more, take it as a bound
    from above.
    """
    if len(first) == 0:
        return {
            "noise_floor_db": None,
            "noise_floor_foreground_db": None,
            "noise_floor_definition": NOISE_FLOOR,
        }
    error = (composite_on_white(first) - composite_on_white(second)) ** 2 / 4
    covered = second[..., 3] > 0
    return {
        "noise_floor_db": _decibels(error),
        "noise_floor_foreground_db": _decibels(error[covered]) if covered.any() else None,
        "noise_floor_definition": NOISE_FLOOR,
    }


def exposure(rgba: np.ndarray) -> dict[str, Any]:
    """Return the clipping attributes of views (n, h, w, 4): 8-bit images of them lose what is above 1."""
    covered = rgba[rgba[..., 3] > 0].astype(np.float32)
    clipped = (covered[:, :3] > covered[:, 3:]).any(axis=1)
    share = float(clipped.mean()) if len(clipped) else 0.0
    warnings = []
    if share > CLIPPED_SHARE:
        warnings.append(f"{100 * share:.1f} % of the covered pixels clip: lower the power of the light")
    return {"clipped_share": share, "clipped_share_definition": CLIPPED, "warnings": warnings}


def _decibels(squared_error: np.ndarray) -> float:
    # Two identical images have no measurable noise; 120 dB is below the resolution of the masters.
    return float(-10 * np.log10(max(float(squared_error.mean()), 1e-12)))


def _renderer() -> str:
    try:
        return f"Cycles, bpy {version('bpy')}"
    except PackageNotFoundError:
        return "Cycles"
