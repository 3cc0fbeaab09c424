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

from objectfolder.vision.appearance import Appearance
from objectfolder.vision.export.credit import NOT_KNOWN, Credit

# x, y, z, w: z up to y up.
Z_UP_TO_Y_UP = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
FLOAT, UNSIGNED_BYTE, UNSIGNED_INT = 5126, 5121, 5125
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
    """

    positions: np.ndarray
    normals: np.ndarray
    texture_coordinates: np.ndarray | None = None
    texture: np.ndarray | None = None
    colours: np.ndarray | None = None
    alpha_cutoff: float | None = None
    metallic_roughness: np.ndarray | None = None


def write_glb(
    path: Path,
    parts: Sequence[Part],
    appearance: Appearance,
    credit: Credit,
    *,
    mipmaps: bool,
    extras: dict[str, Any] | None = None,
) -> None:
    """Write a GLB; equal arguments give equal bytes.

    Parameters
    ----------
    appearance
        Roughness and metallic factors; a specular level other than glTF's own is KHR_materials_specular.
    mipmaps
        Whether readers may use mip maps; blocks of an atlas would run into one another.
    extras
        Added to ``asset.extras``.
    """
    glb = _Buffer()
    document: dict[str, Any] = {
        "asset": {
            "version": "2.0",
            "generator": "ObjectFolder Factory",
            **_copyright(credit),
            "extras": {"object": credit.to_dict(), "unit": "metre", **(extras or {})},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": credit.object_id, "mesh": 0, "rotation": list(Z_UP_TO_Y_UP)}],
        "meshes": [{"name": credit.object_id, "primitives": []}],
        "materials": [],
    }
    for part in parts:
        attributes = {
            "POSITION": glb.accessor(part.positions.reshape(-1, 3), "VEC3", bounds=True),
            "NORMAL": glb.accessor(_unit(part.normals.reshape(-1, 3)), "VEC3"),
        }
        material = _material(appearance, document)
        if part.colours is not None:
            # glTF has vertex colours scene-linear.
            attributes["COLOR_0"] = glb.accessor(_linear(part.colours).reshape(-1, 4), "VEC4")
        else:
            assert part.texture_coordinates is not None
            assert part.texture is not None
            downwards = part.texture_coordinates.reshape(-1, 2) * [1.0, -1.0] + [0.0, 1.0]
            attributes["TEXCOORD_0"] = glb.accessor(downwards, "VEC2")
            _add_textures(document, glb, material, part, mipmaps)
        indices = np.arange(len(part.positions) * 3, dtype="<u4")
        document["meshes"][0]["primitives"].append(
            {
                "attributes": attributes,
                "indices": glb.accessor(indices, "SCALAR", INDICES),
                "material": len(document["materials"]),
                "mode": TRIANGLES,
            }
        )
        document["materials"].append(material)
    document |= {
        "accessors": glb.accessors,
        "bufferViews": glb.views,
        "buffers": [{"byteLength": len(glb.data)}],
    }
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    body = bytes(glb.data)
    with path.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(body)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(body), b"BIN\0") + body)


class _Buffer:
    """The binary chunk, its views and accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def view(self, data: bytes, target: int | None = None) -> int:
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data)})
        if target is not None:
            self.views[-1]["target"] = target
        self.data += data + b"\0" * (-len(data) % 4)
        return len(self.views) - 1

    def accessor(self, values: np.ndarray, kind: str, target: int = VERTICES, *, bounds: bool = False) -> int:
        stored = np.ascontiguousarray(values, dtype="<u4" if target == INDICES else "<f4")
        entry: dict[str, Any] = {
            "bufferView": self.view(stored.tobytes(), target),
            "componentType": UNSIGNED_INT if target == INDICES else FLOAT,
            "count": len(stored),
            "type": kind,
        }
        if bounds:
            entry |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.accessors.append(entry)
        return len(self.accessors) - 1


def _material(appearance: Appearance, document: dict[str, Any]) -> dict[str, Any]:
    material: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "metallicFactor": appearance.metallic,
            "roughnessFactor": appearance.roughness,
        },
        # Scans have open and inverted faces, and the renderer shows both sides.
        "doubleSided": True,
    }
    if appearance.specular != 0.5:
        material["extensions"] = {
            "KHR_materials_specular": {"specularFactor": min(1.0, 2 * appearance.specular)}
        }
        document["extensionsUsed"] = ["KHR_materials_specular"]
    return material


def _add_textures(
    document: dict[str, Any], glb: _Buffer, material: dict[str, Any], part: Part, mipmaps: bool
) -> None:
    assert part.texture is not None
    sampler: dict[str, int] = {"magFilter": LINEAR, "wrapS": REPEAT, "wrapT": REPEAT}
    if not mipmaps:
        sampler["minFilter"] = LINEAR
    document["samplers"] = [sampler]
    reflectance = material["pbrMetallicRoughness"]
    opaque = bool((part.texture[..., 3] == 255).all())
    texture = part.texture[..., :3] if opaque else part.texture
    reflectance["baseColorTexture"] = {"index": _add_image(document, glb, texture)}
    if not opaque:
        material["alphaMode"] = "BLEND" if part.alpha_cutoff is None else "MASK"
        if part.alpha_cutoff is not None:
            material["alphaCutoff"] = part.alpha_cutoff
    if part.metallic_roughness is not None:
        index = _add_image(document, glb, part.metallic_roughness)
        reflectance |= {
            "metallicRoughnessTexture": {"index": index},
            "metallicFactor": 1.0,
            "roughnessFactor": 1.0,
        }


def _add_image(document: dict[str, Any], glb: _Buffer, pixels: np.ndarray) -> int:
    """Store an image as PNG and return the index of a texture of it."""
    encoded = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, "PNG")
    images, textures = document.setdefault("images", []), document.setdefault("textures", [])
    images.append({"bufferView": glb.view(encoded.getvalue()), "mimeType": "image/png"})
    textures.append({"source": len(images) - 1, "sampler": 0})
    return len(textures) - 1


def _copyright(credit: Credit) -> dict[str, str]:
    known = [text for text in (credit.attribution, credit.licence) if text != NOT_KNOWN]
    return {"copyright": "; ".join(known)} if known else {}


def _unit(normals: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A face without area has no normal, and glTF wants one of unit length.
    return np.where(length > 1e-12, normals / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])


def _linear(encoded: np.ndarray) -> np.ndarray:
    from objectfolder.vision.compositing import srgb_decode

    return np.concatenate([srgb_decode(encoded[..., :3]), encoded[..., 3:]], axis=-1)
