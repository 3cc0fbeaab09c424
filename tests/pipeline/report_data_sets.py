"""Small data sets with every product that a report reads, made by code."""

from pathlib import Path
from typing import Any

import numpy as np
from fidelity_products import HELD_OUT, fidelity
from small_meshes import CUBE_FACES, CUBE_VERTICES

from objectfolder.fidelity.contacts import contact_pictures
from objectfolder.fidelity.sheets import webp
from objectfolder.products.store import Array, Product, write_product
from objectfolder.products.tensor_file import TensorFile, write_tensor_file
from objectfolder.surface.surface import Surface

HOSTILE = (
    "<script>document.title='run'</script><img src=x onerror=\"document.title='run'\">'\"&</title></table>"
)
SIDE_M = 0.06
STAGES = ("objects", "views", "modes", "touches", "encoded", "fidelity")
SENSOR = {"name": "DIGIT", "gel_apex_m": [0.022, 0.0, 0.0], "gel_width_m": 0.02, "gel_height_m": 0.03}


def cube() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a cube about the origin, outward."""
    return SIDE_M * CUBE_VERTICES, CUBE_FACES


def sensor_to_object(point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """A pose whose gel meets `point` from outside: the sensor looks along its x axis."""
    forward = -normal
    side = np.cross([0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0], forward)
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([forward, side, np.cross(forward, side)], axis=1)
    pose[:3, 3] = point - pose[:3, :3] @ np.array(SENSOR["gel_apex_m"])
    return pose


def touched(count: int = HELD_OUT["touch"]) -> Product:
    """Touches of a cube, one for training ahead of `count` that are held out."""
    count += 1
    generator = np.random.default_rng(7)
    normals = np.tile([[1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0], [0, 0, -1.0]], (count, 1))[:count]
    spread = generator.uniform(-0.4, 0.4, (count, 3)) * SIDE_M * (normals == 0)
    points = normals * SIDE_M / 2 + spread
    per_touch = {
        "points": points,
        "normals": normals,
        "sensor_to_object": np.stack([sensor_to_object(*pair) for pair in zip(points, normals, strict=True)]),
        "depth_m": np.full(count, 0.001),
        "tilt_deg": np.zeros(count),
        "penetration_m": np.full(count, 0.001),
        "contact_area_m2": np.full(count, 2e-5),
        "held_out": np.arange(count) >= 1,
    }
    arrays = {
        name: Array(value, ("touch", "i", "j")[: value.ndim], "1", name) for name, value in per_touch.items()
    }
    return Product(arrays, {"sensor": SENSOR})


def touch_pictures(touches: Product) -> dict[str, Array]:
    """Where the held-out ones were made, as a fidelity product has it."""
    shown = contact_pictures(Surface(*cube()), touches, touches["held_out"])
    arrays = {
        "touch_sides": webp(shown.sides.reshape(-1, *shown.sides.shape[2:])),
        "touch_side": shown.side,
        "touch_visible": shown.visible,
        "touch_pixels": shown.pixels,
    }
    return {
        name: Array(value, ("i", "j", "k")[: value.ndim], "1", name, chunk_first=False)
        for name, value in arrays.items()
    }


def write_object(
    data: Path,
    object_id: str,
    *,
    text: str = "",
    shift: float = 0.0,
    audible: bool = True,
    senses: str = "vat",
) -> None:
    """Write the products of an object; `text` stands in every field that people fill in.

    Parameters
    ----------
    senses
        First letters of the senses whose arrays the fidelity product has.
    """
    product = fidelity(object_id, name=text or None, shift=shift, audible=audible)
    attributes: dict[str, Any] = dict(product.attributes)
    if text:
        attributes["object"] = dict.fromkeys(
            ("name", "material", "licence", "attribution", "source"), text
        ) | {"id": object_id}
        attributes["definitions"] = {text: text}
    attributes["provenance"] = {
        "fingerprints": {stage: "new" for stage in STAGES},
        "parameters": {text or "steps": text or 60},
        "record": {"material": {"density_kg_m3": 2700.0, text or "note": text}, "material_citation": text},
        "seed": 5,
    }
    touches = touched()
    arrays = {
        name: array
        for name, array in {**product.arrays, **touch_pictures(touches)}.items()
        if {"vision": "v", "strike": "a", "touch": "t"}[name.partition("_")[0]] in senses
    }
    write_product(data / "fidelity" / f"{object_id}.zarr.zip", Product(arrays, attributes))
    vertices, faces = cube()
    mesh = {
        "vertices": Array(vertices, ("vertex", "axis"), "m", "vertices", chunk_first=False),
        "faces": Array(faces, ("face", "corner"), "1", "faces", chunk_first=False),
    }
    write_product(data / "objects" / f"{object_id}.zarr.zip", Product(mesh, {"fingerprint": "object"}))
    write_product(data / "touches" / f"{object_id}.zarr.zip", touches)
    if audible:
        write_modes(data, object_id, [mode["frequency_hz"] for mode in attributes["audio"]["modes_table"]])


def write_modes(data: Path, object_id: str, frequencies_hz: list[float], cents: float = 3.0) -> None:
    """Write modes, and an Object File's tensors whose frequencies are `cents` higher.

    The file holds nothing else, so no player can be made of it.
    """
    count = len(frequencies_hz)
    estimates = np.full(count, 1.5)
    estimates[1:] = np.nan
    points = np.random.default_rng(0).uniform(-1, 1, (6, 3))
    modes = {
        "error_estimates_cents": Array(estimates, ("mode",), "cents", "estimates"),
        "points": Array(points, ("point", "axis"), "m", "points"),
        "held_out": Array(np.arange(6) >= 2, ("point",), "1", "held out"),
    }
    write_product(data / "modes" / f"{object_id}.zarr.zip", Product(modes, {}))
    dampings = np.full(count, 6.0)
    angular = 2 * np.pi * np.array(frequencies_hz) * 2 ** (cents / 1200)
    tensors = {"audio.eigenvalues": angular**2 + dampings**2, "audio.dampings_per_s": dampings}
    write_tensor_file(
        data / "object_files" / f"{object_id}.safetensors", TensorFile(tensors, {"format": "x"})
    )
