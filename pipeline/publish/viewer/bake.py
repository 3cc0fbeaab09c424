"""The data of an Object File for a page without a server, in few bytes.

The surface is stored exactly (its own grid of steps), with its shading normals, and with the colour that the
VisionNet's reflectance amounts to on a lattice of its faces. Sound is stored as what AudioNet answers at some
hundred places, drawn uniformly by area; a page strikes the nearest. Frequencies and dampings are the file's.
At the first of these places that the sensor reaches, its pictures are stored, too.
"""

import base64
import zlib
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from objectfolder.audio.audionet.audionet import AudioNet, control_barycentric
from objectfolder.errors import FormatError
from objectfolder.fidelity.sheets import webp
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from objectfolder.vision.network.face_lattice import FaceLattice
from objectfolder.vision.studio import STUDIOS
from pipeline.publish.export.base_colour import network_colour
from pipeline.publish.viewer import FORMAT
from pipeline.publish.viewer.recursions import recursions

# Gains are one byte each; this many keep an object's script within its budget.
MOST_GAINS = 190_000
LEAST_PLACES, MOST_PLACES = 200, 500
GAIN_STEPS = 127
NORMAL_STEPS, PLACE_NORMAL_STEPS = 127, 32767  # of corners, which only light goes by, and of places
PRESSED_PLACES = 128  # of them those that the sensor reaches have pictures; SHEET_COLUMNS a row
SHEET_COLUMNS = 16
PRESS_DEPTH_M = 0.001
# An export has 24, for it is lit anew elsewhere. With these, colours differ by less than shadows do.
LIGHT_DIRECTIONS = 4
# Between places of colours, unit-frame lengths: the finest that has no more places.
PITCHES = tuple(1 / count for count in (256, 224, 192, 160, 128, 112, 96, 80, 64, 32))
MOST_COLOURS = 150_000
# Samples along each axis of a cell, where a file states colours: their mean leaves edges of prints no steps.
COLOUR_TAPS = 4
USUAL_IMPULSE_N_S = 0.05
PEAK_OF_FULL_SCALE = 0.33
ARRAY_NAMES = {"int8": "Int8Array", "uint8": "Uint8Array", "int16": "Int16Array", "int32": "Int32Array"}
NEARLY_WHITE = 250


def bake(file: ObjectFile) -> tuple[dict[str, Any], bytes]:
    """Return the header of a static player's data, and its arrays, compressed.

    The first has the places of the arrays in the second, see `packed`.
    """
    arrays: dict[str, np.ndarray] = {}
    surface = file.surface
    tensors = file.content().tensors
    step, origin = float(tensors["surface.step"][0]), np.asarray(tensors["surface.origin"])
    grid = np.rint((surface.vertices - origin) / step).astype(np.int64)
    arrays["positions"] = np.diff(grid, axis=0, prepend=0).astype(np.int32)
    arrays["faces"] = np.diff(surface.faces.ravel(), prepend=0).astype(np.int32)
    arrays["normals"] = np.rint(NORMAL_STEPS * surface.corner_normals.reshape(-1, 3).T).astype(np.int8)
    arrays |= surface_colours(file)
    places = stored_places(file)
    arrays |= {
        "place_faces": places.face,
        "place_barycentric": places.barycentric,
        "place_normals": np.rint(PLACE_NORMAL_STEPS * places.normals).astype(np.int16),
    }
    sound, gains = baked_sound(file.modes, places.points)
    touch, reachable_places = baked_touch(file, places.points)
    arrays |= gains | reachable_places
    entries, data = packed(arrays)
    description = file.description["object"]
    material = file.description["material"] or {}
    header = {
        "format": FORMAT,
        "name": description["name"],
        "licence": description["licence"],
        "attribution": description["attribution"],
        "material": material.get("name"),
        "frame": file.frame.to_dict(),
        "field_of_view_deg": FIELD_OF_VIEW_DEG,
        "radiance_scale": file.vision.radiance_scale,
        "surface": {"origin": origin.tolist(), "step": step},
        "sound": sound,
        "touch": touch,
        "listening_gain": listening_gain(file),
        "brightness": {name: brightness(file, name) for name in STUDIOS},
        "arrays": entries,
    }
    return header, data


class Places(NamedTuple):
    """Places of stored answers: faces (n,) int32, two barycentric coordinates (n, 2) uint8; where they are.

    Points and normals are (n, 3), object frame.
    """

    face: np.ndarray
    barycentric: np.ndarray
    points: np.ndarray
    normals: np.ndarray


def stored_places(file: ObjectFile) -> Places:
    """Return where a player has answers: drawn uniformly by area, as many as their gains have room."""
    count = MOST_GAINS // (3 * max(1, len(file.modes.eigenvalues)))
    sample = file.surface.sample(min(MOST_PLACES, max(LEAST_PLACES, count)), seed=0)
    barycentric = np.floor(255 * sample.barycentric[:, :2]).astype(np.uint8)
    where = sample.face, control_barycentric(barycentric)
    points, normals = file.surface.points_at(*where), file.surface.normals_at(*where)
    return Places(sample.face.astype(np.int32), barycentric, points, normals)


def baked_sound(modes: AudioNet, points: np.ndarray) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return modes for the header, as pages make them sound, and their gains at places."""
    header: dict[str, Any] = {
        "frequencies_hz": modes.frequencies_hz.tolist(),
        "dampings_per_s": modes.dampings_per_s.tolist(),
        "sample_rate_hz": SAMPLE_RATE_HZ,
    }
    if not len(modes.eigenvalues):
        return header, {}
    header["recursions"] = recursions(modes.eigenvalues, modes.dampings_per_s).tolist()
    gains = modes.gains(points)
    scale = np.maximum(np.abs(gains).max(axis=(0, 1), initial=0.0), 1e-300) / GAIN_STEPS
    return header | {"gain_steps": scale.tolist()}, {
        "gains": np.rint(gains / scale).astype(np.int8).transpose(2, 1, 0)
    }


def baked_touch(file: ObjectFile, points: np.ndarray) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return a sheet of the sensor's pictures for the header, and the places of which it has them."""
    touches = file.press(points[:PRESSED_PLACES], PRESS_DEPTH_M)
    reachable_places = np.flatnonzero(touches.reachable)
    height, width = touches.rgb.shape[1:3]
    rows = -(-len(reachable_places) // SHEET_COLUMNS)
    sheet = np.zeros((rows, SHEET_COLUMNS, height, width, 3), np.uint8)
    sheet.reshape(-1, height, width, 3)[: len(reachable_places)] = touches.rgb[reachable_places]
    pictures = webp(sheet.swapaxes(1, 2).reshape(rows * height, -1, 3)) if rows else np.zeros(0, np.uint8)
    return {
        "sensor": file.touch.net.sensor.name,
        "depth_m": PRESS_DEPTH_M,
        "height": height,
        "width": width,
        "columns": SHEET_COLUMNS,
        "sheet": f"data:image/webp;base64,{base64.b64encode(pictures.tobytes()).decode()}",
    }, {"reached_places": reachable_places.astype(np.int32)}


def surface_colours(file: ObjectFile) -> dict[str, np.ndarray]:
    """Return colours on a lattice of the faces, and where its places lie.

    A colour is what the file states, or the share of light from all directions that leaves along the normal,
    by the VisionNet, without what a clear coat reflects.

    Returns
    -------
    dict
        ``colours`` (p, 3) uint8 sRGB, each less the one before; ``grids`` (F, 3) int32 first corner of each
        face and steps along two edges, as of `FaceLattice.grids`.
    """
    lattice = _lattice(file.frame.to_unit(file.surface.vertices)[file.surface.faces])
    metallic = float((file.description["material"] or {}).get("metallic", 0.0))
    taps = COLOUR_TAPS if file.vision.states("albedo") else 1
    steps = (np.arange(taps) + 0.5) / taps - 0.5
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
    colours = sum(
        network_colour(file.vision, file.surface, file.frame, *places, metallic, LIGHT_DIRECTIONS)[:, :3]
        for places in map(lattice.places, offsets)
    )
    levels = np.rint(colours * (255 / taps**2)).astype(np.uint8)
    corners, columns, rows, _ = lattice.grids
    return {
        "colours": np.diff(levels, axis=0, prepend=np.zeros((1, 3), dtype=np.uint8)),
        "grids": np.stack([corners[:, 0], columns, rows], axis=1).astype(np.int32),
    }


def _lattice(triangles: np.ndarray) -> FaceLattice:
    """Return the finest lattice of `PITCHES` that has room, on triangles of the unit frame.

    Of more faces than that the corners alone have colours.
    """
    for pitch in PITCHES:
        with suppress(FormatError):
            return FaceLattice(triangles, pitch, shared=False, most=MOST_COLOURS)
    return FaceLattice(triangles, np.inf, shared=False, most=4 * len(triangles))


def brightness(file: ObjectFile, studio: str) -> float:
    """Return the mean level, 0 to 1 as displayed, of the object in its pictures: the player's, too."""
    images = file.pictures(3, 48, studio=studio, sub_rays=4)
    pixels = images[(images < NEARLY_WHITE).any(axis=-1)]
    return float(pixels.mean() / 255) if len(pixels) else 1.0


def listening_gain(file: ObjectFile) -> float:
    """Return the factor at which a usual blow at a typical place peaks at a third of full scale.

    One factor an object: a harder blow is louder, as it is.
    """
    points, normals = file.sample_contacts(9, seed=0, reachable=False)
    if not len(file.modes.eigenvalues):
        return 1.0
    sounds = file.strike(points, -USUAL_IMPULSE_N_S * normals, duration_s=0.05)
    peak = float(np.median(np.abs(sounds).max(axis=1)))
    return PEAK_OF_FULL_SCALE / peak if peak > 0 else 1.0


def packed(arrays: Mapping[str, np.ndarray]) -> tuple[dict[str, Any], bytes]:
    """Return where each array lies, and all of them, deflated.

    The bytes of an array are stored in planes, all lowest bytes first: the upper ones are nearly
    constant and compress to little.

    Returns
    -------
    tuple
        For each name ``type`` (a JavaScript typed array), ``shape`` and ``offset`` in bytes; a zlib stream.
    """
    entries: dict[str, Any] = {}
    parts: list[bytes] = []
    offset = 0
    for name, array in arrays.items():
        values = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"))
        entries[name] = {
            "type": ARRAY_NAMES[array.dtype.name],
            "shape": list(array.shape),
            "offset": offset,
        }
        planes = values.reshape(-1).view(np.uint8).reshape(-1, array.dtype.itemsize).T
        parts.append(planes.tobytes())
        offset += values.nbytes
    return entries, zlib.compress(b"".join(parts), 6)
