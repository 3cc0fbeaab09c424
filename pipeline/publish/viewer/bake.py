"""What a page without a server needs of an Object File, as few bytes.

The surface is stored exactly (its own grid of steps), with the colour that the VisionNet's reflectance
amounts to at each vertex and in the middle of each edge. Sound is stored as the gains at the first of
AudioNet's control points, which are spread out in every leading part; the page interpolates them with
AudioNet's own covariance. Frequencies and dampings are the file's.
"""

from typing import Any

import numpy as np

from objectfolder.audio.audionet import DETOUR_STEP, AudioNet, control_barycentric, decode_detours, size_of
from objectfolder.geometry.surface import Surface
from objectfolder.object_file import ObjectFile
from objectfolder.vision.cameras import FIELD_OF_VIEW_DEG
from pipeline.publish.viewer.colours import surface_colours
from pipeline.publish.viewer.live_sound import listening_gain
from pipeline.publish.viewer.packing import packed

# Gains are one byte each; this many keep an object's script within its budget.
MOST_GAINS = 190_000
LEAST_POINTS = 200
GAIN_STEPS = 127
# Raise it when what is stored changes: kept players of another format are made anew.
FORMAT = 2


def bake(file: ObjectFile) -> tuple[dict[str, Any], bytes]:
    """Return what a static player is told of an object, and its arrays, compressed.

    The first has the places of the arrays in the second, see `packing.packed`.
    """
    arrays: dict[str, np.ndarray] = {}
    surface = file.surface
    tensors = file.content().tensors
    step, origin = float(tensors["surface.step"][0]), np.asarray(tensors["surface.origin"])
    grid = np.rint((surface.vertices - origin) / step).astype(np.int64)
    arrays["positions"] = np.diff(grid, axis=0, prepend=0).astype(np.int32)
    arrays["faces"] = np.diff(surface.faces.ravel(), prepend=0).astype(np.int32)
    arrays["colours"] = surface_colours(file)
    sound, of_sound = baked_sound(file.modes, surface)
    arrays |= of_sound
    described, data = packed(arrays)
    said = file.description["object"]
    material = file.description["material"] or {}
    header = {
        "format": FORMAT,
        "name": said["name"],
        "licence": said["licence"],
        "attribution": said["attribution"],
        "material": material.get("name"),
        "frame": file.frame.to_dict(),
        "field_of_view_deg": FIELD_OF_VIEW_DEG,
        "radiance_scale": file.vision.radiance_scale,
        "surface": {"origin": origin.tolist(), "step": step},
        "sound": sound,
        "listening_gain": listening_gain(file),
        "sensor": file.touch.sensor.to_dict() | {"photometric_table": None},
        "arrays": described,
    }
    return header, data


def baked_sound(modes: AudioNet, surface: Surface) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return modes and covariance for the header, and gains at some control points."""
    tensors, metadata = modes.tensors(), modes.metadata()
    count = len(modes.eigenvalues)
    dimensions = int(metadata["detour_dimensions"])
    step = DETOUR_STEP * size_of(surface)
    header: dict[str, Any] = {
        "eigenvalues": modes.eigenvalues.tolist(),
        "dampings_per_s": modes.dampings_per_s.tolist(),
        "radiation_weights": modes.radiation_weights.tolist(),
        "kernel": metadata["kernel"],
        "detour_dimensions": dimensions,
        "detour_step_m": step,
    }
    if not count:
        return header, {}
    points = min(int(metadata["control_points"]), max(LEAST_POINTS, MOST_GAINS // (3 * count)))
    face = tensors["audio.control_faces"][:points]
    stored = tensors["audio.control_barycentric"][:points]
    gains = modes.gains(surface.points_at(face, control_barycentric(stored)))
    scale = np.maximum(np.abs(gains).max(axis=(0, 1)), 1e-300) / GAIN_STEPS
    header["gain_steps"] = scale.tolist()
    detours = decode_detours(tensors["audio.detours"], len(surface.vertices), dimensions, size_of(surface))
    return header, {
        "control_faces": face.astype(np.int32),
        "control_barycentric": stored,
        "detours": np.diff(np.rint(detours / step).astype(np.int32), axis=0, prepend=0).astype(np.int32),
        "gains": np.rint(gains / scale).astype(np.int8).transpose(2, 1, 0),
    }
