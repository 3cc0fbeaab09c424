"""Binary glTF 2.0 (GLB): one mesh, one physically based material a texture, metres, +y up.

Vertex positions stay in the object frame, z up; the node turns them by -90 degrees about x, so that a reader
that applies the node has glTF's axes and one that reads the mesh alone has the object frame.
"""

import io
import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from objectfolder.export.files import NOT_KNOWN, Credit
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.compositing import srgb_decode

# x, y, z, w: z up to y up.
Z_UP_TO_Y_UP = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
FLOAT, UNSIGNED_INT = 5126, 5125
VERTICES, INDICES = 34962, 34963
TRIANGLES, LINEAR, REPEAT = 4, 9729, 10497


@dataclass(frozen=True)
class Part:
    """Triangles with one material; vertices are not shared between faces.

    Parameters
    ----------
    positions, normals
        (f, 3, 3) metres, object frame; unit shading normals.
    texture_coordinates
        (f, 3, 2), v up; None with `colours`.
    texture
        (h, w, 4) uint8 sRGB with straight alpha, row 0 on top; None with `colours`.
    colours
        (f, 3, 4) sRGB-encoded RGBA of the corners in 0..1, in place of a texture.
    alpha_cutoff
        Alpha in 0..1 from which the surface is there; None blends where alpha is below 1.
    metallic_roughness
        (h, w, 3) uint8 linear: green is roughness, blue metallic, in place of the factors.
    normal_map
        (h, w, 3) uint8 normals in tangent space, -1..1 as 0..255.
    """

    positions: np.ndarray
    normals: np.ndarray
    texture_coordinates: np.ndarray | None = None
    texture: np.ndarray | None = None
    colours: np.ndarray | None = None
    alpha_cutoff: float | None = None
    metallic_roughness: np.ndarray | None = None
    normal_map: np.ndarray | None = None


def write_glb(
    path: Path, parts: Sequence[Part], appearance: Appearance, credit: Credit, *,
    mipmaps: bool, extras: dict[str, Any] | None = None,
) -> None:  # fmt: skip
    """Write a GLB; equal arguments give equal bytes.

    Parameters
    ----------
    appearance
        Roughness and metallic factors; a specular level other than glTF's own is KHR_materials_specular, thin
        glass KHR_materials_transmission.
    mipmaps
        Whether readers may use mip maps; blocks of an atlas would run into one another.
    extras
        Added to ``asset.extras``.
    """
    glb = _Document(mipmaps)
    primitives = [_primitive(glb, part, appearance) for part in parts]
    name = credit.object_id
    glb.write(path, {
        "asset": {
            "version": "2.0",
            "generator": "ObjectFolder Factory",
            **_copyright(credit),
            "extras": {"object": credit.to_dict(), "unit": "metre", **(extras or {})},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0, "rotation": list(Z_UP_TO_Y_UP)}],
        "meshes": [{"name": name, "primitives": primitives}],
        **({"extensionsUsed": sorted(extensions)} if (extensions := _extensions(appearance)) else {}),
    })  # fmt: skip


class _Document:
    """The binary chunk of a GLB, and the lists of the JSON chunk that refer to it or to one another."""

    def __init__(self, mipmaps: bool) -> None:
        sampler = {"magFilter": LINEAR, "wrapS": REPEAT, "wrapT": REPEAT}
        self.sampler = sampler if mipmaps else {**sampler, "minFilter": LINEAR}
        self.data = bytearray()
        self.lists: dict[str, list[dict[str, Any]]] = {}

    def add(self, name: str, entry: dict[str, Any]) -> int:
        """Append to the list of that name and return the index there."""
        entries = self.lists.setdefault(name, [])
        entries.append(entry)
        return len(entries) - 1

    def view(self, data: bytes, **more: int) -> int:
        start = len(self.data)
        self.data += data + b"\0" * (-len(data) % 4)
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **more})

    def accessor(self, values: np.ndarray, kind: str, target: int = VERTICES, *, bounds: bool = False) -> int:
        stored = np.ascontiguousarray(values, dtype="<u4" if target == INDICES else "<f4")
        entry: dict[str, Any] = {
            "bufferView": self.view(stored.tobytes(), target=target),
            "componentType": UNSIGNED_INT if target == INDICES else FLOAT,
            "count": len(stored),
            "type": kind,
        }
        if bounds:
            entry |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def texture(self, pixels: np.ndarray) -> dict[str, int]:
        """Store an image as PNG and return a reference to a texture of it."""
        encoded = io.BytesIO()
        Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, "PNG")
        image = {"bufferView": self.view(encoded.getvalue()), "mimeType": "image/png"}
        self.lists["samplers"] = [self.sampler]
        return {"index": self.add("textures", {"source": self.add("images", image), "sampler": 0})}

    def write(self, path: Path, document: dict[str, Any]) -> None:
        document = {**document, **self.lists, "buffers": [{"byteLength": len(self.data)}]}
        text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        with path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(self.data)))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", len(self.data), b"BIN\0") + self.data)


def _primitive(glb: _Document, part: Part, appearance: Appearance) -> dict[str, Any]:
    attributes = {
        "POSITION": glb.accessor(part.positions.reshape(-1, 3), "VEC3", bounds=True),
        "NORMAL": glb.accessor(_unit(part.normals.reshape(-1, 3)), "VEC3"),
    }
    if part.colours is not None:
        # glTF has vertex colours scene-linear.
        linear = np.concatenate([srgb_decode(part.colours[..., :3]), part.colours[..., 3:]], axis=-1)
        attributes["COLOR_0"] = glb.accessor(linear.reshape(-1, 4), "VEC4")
    if part.texture_coordinates is not None:
        downwards = part.texture_coordinates.reshape(-1, 2) * [1.0, -1.0] + [0.0, 1.0]
        attributes["TEXCOORD_0"] = glb.accessor(downwards, "VEC2")
    indices = np.arange(len(part.positions) * 3, dtype="<u4")
    return {
        "attributes": attributes,
        "indices": glb.accessor(indices, "SCALAR", INDICES),
        "material": glb.add("materials", _material(glb, part, appearance)),
        "mode": TRIANGLES,
    }


def _material(glb: _Document, part: Part, appearance: Appearance) -> dict[str, Any]:
    reflectance: dict[str, Any] = {
        "metallicFactor": appearance.metallic,
        "roughnessFactor": appearance.roughness,
    }
    # Scans have open and inverted faces, and the renderer shows both sides.
    material: dict[str, Any] = {"pbrMetallicRoughness": reflectance, "doubleSided": True}
    if extensions := _extensions(appearance):
        material["extensions"] = extensions
    if part.texture is not None:
        opaque = bool((part.texture[..., 3] == 255).all())
        reflectance["baseColorTexture"] = glb.texture(part.texture[..., :3] if opaque else part.texture)
        if not opaque:
            material["alphaMode"] = "BLEND" if part.alpha_cutoff is None else "MASK"
            if part.alpha_cutoff is not None:
                material["alphaCutoff"] = part.alpha_cutoff
    if part.metallic_roughness is not None:
        maps = glb.texture(part.metallic_roughness)
        reflectance |= {"metallicRoughnessTexture": maps, "metallicFactor": 1.0, "roughnessFactor": 1.0}
    if part.normal_map is not None:
        material["normalTexture"] = glb.texture(part.normal_map)
    return material


def _extensions(appearance: Appearance) -> dict[str, dict[str, float]]:
    """Return what glTF's own model does not say of a material."""
    specular = {"KHR_materials_specular": {"specularFactor": min(1.0, 2 * appearance.specular)}}
    through = {"KHR_materials_transmission": {"transmissionFactor": 1.0}}
    return (specular if appearance.specular != 0.5 else {}) | (through if appearance.thin else {})


def _copyright(credit: Credit) -> dict[str, str]:
    known = [text for text in (credit.attribution, credit.licence) if text != NOT_KNOWN]
    return {"copyright": "; ".join(known)} if known else {}


def _unit(normals: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A face without area has no normal, and glTF wants one of unit length.
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])
