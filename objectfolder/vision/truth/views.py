"""The ground truth of sight: path-traced views of an object under a moving point light."""

from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from objectfolder.errors import InputError
from objectfolder.mesh.mesh import TexturedMesh
from objectfolder.products.store import Array, Product
from objectfolder.surface.frames import UnitFrame
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
from objectfolder.vision.truth.cycles_process import render_in_children
from objectfolder.vision.truth.passes import Passes, cast_passes
from objectfolder.vision.truth.render_request import BOUNCES, LIGHT_POWER_W, Shots, unit_scene

# Held-out views rendered a second time to measure the noise that is left in them.
NOISE_VIEWS = 2
# Seeds are below 2^30; this bit makes the seed of a repeat.
REPEAT = 1 << 30
NOISE_FLOOR = (
    "PSNR on white of the held-out views against the noise-free image: 3.01 dB above the PSNR between two "
    "renders of the first held-out views with independent seeds at the held-out sample count, squared "
    "errors pooled; foreground: over pixels that the object covers in part or whole"
)

TRANSMISSION = (
    "none: glass and other clear materials are drawn as glossy opaque surfaces, for caustics of a point "
    "light cannot be path traced; light passes only through holes (alpha)"
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
    mesh: TexturedMesh,
    appearance: Appearance,
    *,
    resolution: int | tuple[int, int],
    training_views: int,
    training_samples: int,
    held_out_views: int,
    held_out_samples: int,
    field_of_view_deg: float = FIELD_OF_VIEW_DEG,
    camera_radius: float = CAMERA_RADIUS,
    light_power_w: float = LIGHT_POWER_W,
    seed: int = 0,
    threads: int = 1,
    passes: bool = True,
) -> Product:
    """Render an object from cameras uniform on a sphere, each with a light uniform on the unit sphere.

    Equal arguments give equal bytes, whatever `threads`. Training views do not depend on the number of
    held-out views, nor these on that of training views.

    Parameters
    ----------
    mesh
        The object, metres; rendered in its unit frame.
    appearance
        Reflectance besides the base colour.
    resolution
        Pixels a side, or (height, width).
    training_views, held_out_views
        How many views; the held-out ones come last.
    training_samples, held_out_samples
        Paths a pixel.
    field_of_view_deg
        Angle over the longer side.
    camera_radius
        Distance of the cameras from the origin of the unit frame.
    light_power_w
        Radiant power of the point light, for distances in the unit frame.
    seed
        Of cameras, lights and paths.
    threads
        Render threads.
    passes
        False leaves out depth, normal, albedo and mask, which compress to several times the size of the
        images and can be cast again at any time (`passes.cast_passes`).

    Returns
    -------
    Product
        ``rgba`` (view, y, x, channel) float16 scene-linear premultiplied, averaged over each pixel;
        ``depth``, ``normal``, ``albedo`` and ``mask`` at its centre (see `passes.Passes`);
        ``camera_to_world`` (view, 4, 4) and ``light_position`` (view, 3) in the unit frame, ``held_out``,
        ``samples`` and ``seed`` (view,).
        Attributes say how it was made, how much noise is left, and in ``warnings`` what is wrong with it.

    Raises
    ------
    InputError
        A count or size that is not positive.
    SimulationError
        Blender is missing or failed.
    """
    height, width = image_size(resolution)
    for name, value in {
        "training_views": training_views, "training_samples": training_samples,
        "held_out_samples": held_out_samples, "camera_radius": camera_radius, "light_power_w": light_power_w,
    }.items():  # fmt: skip
        if value <= 0:
            raise InputError(f"views.{name}", f"{value} is not positive", "Give a positive number.")
    if held_out_views < 0:
        raise InputError("views.held_out_views", f"{held_out_views} is negative", "Give 0 or more.")
    frame = UnitFrame.of_points(mesh.vertices[np.unique(mesh.faces)])
    scene = unit_scene(mesh, appearance, frame)
    training_stream, held_out_stream = np.random.SeedSequence(seed).spawn(2)
    training = _draw(training_stream, training_views, camera_radius)
    held_out = _draw(held_out_stream, held_out_views, camera_radius)
    # The repeats that measure the noise ride with the held-out views: same sample count, same process.
    repeated = (held_out[0][:NOISE_VIEWS], held_out[1][:NOISE_VIEWS], held_out[2][:NOISE_VIEWS] ^ REPEAT)

    def rendered(views: Drawn, samples: int) -> np.ndarray:
        return render_in_children(
            scene,
            Shots(*views, samples, height, width, field_of_view_deg, light_power_w, BOUNCES, threads),
        )

    noisy = rendered(_joined(held_out, repeated), held_out_samples)
    rgba = np.concatenate([rendered(training, training_samples), noisy[:held_out_views]])
    floors = noise_floor(noisy[:NOISE_VIEWS], noisy[held_out_views:])
    cameras, lights, seeds = _joined(training, held_out)
    kept = np.arange(len(rgba)) >= training_views
    more = {}
    if passes:
        more = _pass_arrays(cast_passes(scene, cameras, (height, width), field_of_view_deg))
    samples = np.where(kept, held_out_samples, training_samples).astype(np.int32)
    return Product(
        {
            "rgba": Array(
                rgba, ("view", "y", "x", "channel"), "1", "scene-linear premultiplied RGBA radiance"
            ),
            "camera_to_world": Array(
                cameras, ("view", "row", "column"), "1", "camera pose in the unit frame, OpenGL convention"
            ),
            "light_position": Array(lights, ("view", "axis"), "1", "point light in the unit frame"),
            "held_out": Array(kept, ("view",), "1", "kept from training"),
            "samples": Array(samples, ("view",), "1", "paths a pixel"),
            "seed": Array(seeds, ("view",), "1", "seed of the path sampler"),
            **more,
        },
        {
            "field_of_view_deg": float(field_of_view_deg),
            "focal_length_px": focal_length_px((height, width), field_of_view_deg),
            "camera_radius": float(camera_radius),
            "light_radius": LIGHT_RADIUS,
            "light_power_w": float(light_power_w),
            "bounces": BOUNCES,
            "appearance": appearance.to_dict(),
            "frame": frame.to_dict(),
            "background": "none: alpha 0; on white by compositing.on_white",
            "pixel_filter": "box of one pixel",
            "renderer": _renderer(),
            "transmission": TRANSMISSION,
            "maps": {
                "roughness": len(mesh.roughness_maps),
                "metallic": len(mesh.metallic_maps),
                "holes": scene.has_holes,
            },
            "seed": seed,
            **floors,
            **exposure(rgba[kept] if held_out_views else rgba),
        },
    )


def _pass_arrays(passes: Passes) -> dict[str, Array]:
    return {
        "depth": Array(
            passes.depth,
            ("view", "y", "x"),
            "1",
            "depth along the camera's -z axis at the pixel's centre",
        ),
        "normal": Array(
            passes.normal,
            ("view", "y", "x", "axis"),
            "1",
            "shading normal at the pixel's centre, unit frame",
        ),
        "albedo": Array(
            passes.albedo,
            ("view", "y", "x", "channel"),
            "1",
            "scene-linear base colour at the pixel's centre",
        ),
        "mask": Array(passes.mask, ("view", "y", "x"), "1", "the pixel's centre shows the object"),
    }


def _draw(
    stream: np.random.SeedSequence, count: int, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    camera, light, path = (np.random.default_rng(child) for child in stream.spawn(3))
    poses = look_at(uniform_on_sphere(count, radius, camera)).reshape(-1, 4, 4)
    return (
        poses,
        uniform_on_sphere(count, LIGHT_RADIUS, light),
        path.integers(0, 2**30, count, dtype=np.int32),
    )


def _joined(first: Drawn, second: Drawn) -> Drawn:
    return (
        np.concatenate([first[0], second[0]]),
        np.concatenate([first[1], second[1]]),
        np.concatenate([first[2], second[2]]),
    )


def noise_floor(first: np.ndarray, second: np.ndarray) -> dict[str, Any]:
    """Return the noise attributes of two renders (n, h, w, 4) of the same views with independent seeds.

    The squared difference of two independent renders is in mean twice that of one and the truth, but for what
    both have wrong alike: noise that the sRGB encoding turns into darker means. Against 4096 samples a pixel
    (a mug, 128 x 128) two views at 256 samples store 60.4 dB where each render has 61.0 and 61.8, four 61.4
    for 61.7 and 61.8. At 32 and 64 samples, where the encoding's bias counts, two views store 0.6 to 0.9 dB
    too much, four up to 2.2: with fewer than 256 held-out samples take it as a bound from above. A bowl of
    metal agrees within 0.2 dB of the mean of the two renders at 32 and at 256.
    """
    if len(second) == 0:
        return {
            "noise_floor_db": None,
            "noise_floor_foreground_db": None,
            "noise_floor_definition": NOISE_FLOOR,
        }
    error = (composite_on_white(first[: len(second)]) - composite_on_white(second)) ** 2 / 2
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
