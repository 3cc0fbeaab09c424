"""Ground truth of touch: presses that cover a surface by area, or at each of its vertices."""

import numpy as np

from objectfolder.making.touches.opengl import COMPILED, check_drawable, draw_touches
from objectfolder.products.store import Array, Product
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.press import press
from objectfolder.touch.presses.touches import Press, Touches
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor

HELD_OUT_STREAM = 1


def simulate_touches(
    surface: Surface,
    sensor: Sensor,
    *,
    touches: int,
    held_out_touches: int,
    depth_m: tuple[float, float] = (0.0005, 0.002),
    tilt_deg: float = 15.0,
    at_vertices: bool = False,
    contact: str = "rigid",
    renderer: str = "compiled",
    samples: int = 2,
    seed: int = 0,
) -> Product:
    """Press `sensor` against a surface at points drawn uniformly by area.

    Depth is uniform in its range, tilt from 0 to its limit, its azimuth round the normal. The
    held-out touches have a random stream of their own: they do not change with the number of the others.

    Parameters
    ----------
    surface
        Object frame, metres.
    sensor
        What to press.
    touches, held_out_touches
        How many of each.
    depth_m
        Least and most, from first contact.
    tilt_deg
        Most, from the contact normal.
    at_vertices
        Instead of random points, one touch at each vertex; at `touches` of them, drawn without
        replacement, where there are more.
    contact
        ``"rigid"`` or ``"elastic"``: the contact model, see `objectfolder.touch.presses.touches.Press`.
    renderer
        ``"compiled"``, or ``"pyrender"``: rigid touches as TACTO draws them, see
        `objectfolder.making.touches.opengl.draw_touches`.
    samples
        Samples along each side of a pixel, of the compiled renderer.
    seed
        Of points, depths and tilts.

    Returns
    -------
    Product
        Arrays over ``touch``, the held-out ones last: ``rgb``, ``depth``, ``mask``, ``sensor_to_object``,
        ``points``, ``normals``, ``depth_m`` and ``tilt_deg`` and ``azimuth_deg`` as asked, ``reachable``,
        ``first_contact_offset_m``, ``penetration_m``, ``contact_area_m2``, ``force_n``, ``saturated``,
        ``held_out``; and ``no_contact`` (y, x, channel), the image of the untouched gel. Attributes:
        ``sensor``, ``contact``, ``samples``, ``seed``, ``reachable_fraction``. Of pyrender, also the arrays
        ``compiled_rgb``, ``compiled_depth`` and ``compiled_mask``, the held-out touches by the compiled
        renderer, and the attribute ``renderer``, with the driver's name.

    Raises
    ------
    InputError
        What the renderer cannot draw, see `objectfolder.making.touches.opengl.check_drawable`.
    MissingPackageError, SimulationError
        Neither pyrender nor EGL.

    Examples
    --------
    >>> from pathlib import Path
    >>> from objectfolder.making import load_mesh
    >>> from objectfolder.touch import Sensor
    >>> bar = load_mesh(Path("bar.obj")).surface
    >>> touches = simulate_touches(bar, Sensor(), touches=1, held_out_touches=2, seed=0)
    >>> touches["rgb"].shape, touches["held_out"].tolist()
    ((3, 160, 120, 3), [False, True, True])
    """
    check_drawable(renderer, sensor, contact)
    training = _vertices(surface, touches, seed) if at_vertices else surface.sample(touches, seed).points
    held_out_seed = int(np.random.SeedSequence([seed, HELD_OUT_STREAM]).generate_state(1)[0])
    points = np.concatenate([training, surface.sample(held_out_touches, held_out_seed).points])
    queries = _queries(((len(training), seed), (held_out_touches, held_out_seed)), depth_m, tilt_deg)
    depth, tilt, azimuth = queries.T
    query = Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=samples, contact=contact)
    pressed, untouched = press(surface, sensor, points, query), no_contact_image(sensor, samples)
    reachable = float(pressed.reachable.mean()) if len(points) else 0.0
    attributes = {"contact": contact, "samples": samples, "seed": seed, "reachable_fraction": reachable}
    if renderer == COMPILED:
        arrays = _arrays(pressed, untouched, queries, len(training))
        return Product(arrays, {"sensor": sensor.to_dict(), **attributes})
    drawn, untouched, driver = draw_touches(surface, sensor, pressed)
    arrays = _arrays(drawn, untouched, queries, len(training)) | _compiled_arrays(pressed[len(training) :])
    attributes["renderer"] = {"name": renderer, "driver": driver}
    return Product(arrays, {"sensor": sensor.to_dict(), **attributes})


def _vertices(surface: Surface, count: int, seed: int) -> np.ndarray:
    """Up to `count` of the vertices that faces use, in their order."""
    used = np.unique(surface.faces)
    if len(used) > count:
        used = np.sort(np.random.default_rng(seed).choice(used, count, replace=False))
    return surface.vertices[used]


def _queries(
    streams: tuple[tuple[int, int], ...], depth_m: tuple[float, float], tilt_deg: float
) -> np.ndarray:
    """Depth, tilt and azimuth (n, 3): of each random stream, (count, seed), as many as it counts."""
    random = np.concatenate([np.random.default_rng([seed, 2]).random((count, 3)) for count, seed in streams])
    low = np.array([depth_m[0], 0.0, 0.0])
    high = np.array([depth_m[1], tilt_deg, 360.0])
    return np.asarray(low + random * (high - low))


def _compiled_arrays(pressed: Touches) -> dict[str, Array]:
    image, same = ("compared", "y", "x"), "of the held-out touches by the compiled renderer"
    return {
        "compiled_rgb": Array(pressed.rgb, (*image, "channel"), "1", f"images {same}"),
        "compiled_depth": Array(pressed.depth_m, image, "m", f"depth {same}"),
        "compiled_mask": Array(pressed.mask, image, "1", f"masks {same}"),
    }


def _arrays(pressed: Touches, untouched: np.ndarray, queries: np.ndarray, training: int) -> dict[str, Array]:
    image, (depth, tilt, azimuth) = ("touch", "y", "x"), queries.T
    held_out = np.arange(len(queries)) >= training
    return {
        "no_contact": Array(untouched, ("y", "x", "channel"), "1", "untouched gel", False),
        "rgb": Array(pressed.rgb, (*image, "channel"), "1", "image of the sensor, 8 bit, without noise"),
        "depth": Array(pressed.depth_m, image, "m", "depth of the object in the undeformed gel"),
        "mask": Array(pressed.mask, image, "1", "pixels that see the object in the gel"),
        "sensor_to_object": Array(
            pressed.sensor_to_object, ("touch", "row", "column"), "m", "pose of the sensor", False
        ),
        "points": Array(pressed.points, ("touch", "xyz"), "m", "touched points, object frame", False),
        "normals": Array(pressed.normals, ("touch", "xyz"), "1", "contact normals, object frame", False),
        "reachable": Array(pressed.reachable, ("touch",), "1", "the sensor can touch the point", False),
        "first_contact_offset_m": Array(
            pressed.first_contact_offset_m, ("touch",), "m", "travel from first contact to the point", False
        ),
        "penetration_m": Array(pressed.penetration_m, ("touch",), "m", "deepest indentation", False),
        "contact_area_m2": Array(pressed.contact_area_m2, ("touch",), "m2", "area seen in the gel", False),
        "force_n": Array(
            pressed.force_n, ("touch",), "N", "force along the axis; NaN: the rigid model has none", False
        ),
        "saturated": Array(pressed.saturated, ("touch",), "1", "the gel is pressed as far as it goes", False),
        "depth_m": Array(depth, ("touch",), "m", "depth asked for, from first contact", False),
        "tilt_deg": Array(tilt, ("touch",), "degree", "lean of the sensor from the normal", False),
        "azimuth_deg": Array(azimuth, ("touch",), "degree", "direction of the lean", False),
        "held_out": Array(held_out, ("touch",), "1", "kept from training", False),
    }
