"""Images of any common kind: base colours to RGBA uint8, maps of one quantity to grey uint8.

Colours stay sRGB-encoded as stored, and maps linear; embedded colour profiles and Exif orientation are not
applied.
"""

import io
import warnings
from pathlib import Path

import numpy as np
from PIL import Image, UnidentifiedImageError

from objectfolder.errors import InputError
from objectfolder.making.mesh.readers.files import brief, is_file, read_bytes

LARGEST_SIDE = 16384
"""Texels along a side."""

MOST_TEXELS = 2**26
"""Of one image, 8192 by 8192; a larger one takes more memory and time than one task has for a picture."""

TEXTURE_BYTES = 2**30
"""Of all textures and maps of a mesh: 16 textures of 4096 a side."""

_FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "TGA", "BMP", "GIF", "PPM", "DDS")
"""What is decoded. Of Pillow's others some start programs, and most are no textures."""

_SIXTEEN_BIT_MODES = ("I", "I;16", "I;16B", "I;16L", "I;16N")


def read_texture(path: Path) -> np.ndarray:
    """Read an image file as (h, w, 4) uint8 RGBA.

    Raises
    ------
    InputError
        The file is missing, is not an image, is truncated, too large, or of floating point values.
    """
    if not is_file(path):
        raise InputError(str(path), "the texture file does not exist", "Correct the path or add the file")
    return decode_texture(read_bytes(path), str(path))


def decode_texture(data: bytes, where: str) -> np.ndarray:
    """Decode the bytes of an image file; `where` names it in errors. See `rgba_of`."""
    try:
        with warnings.catch_warnings():
            # Sizes are checked below.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
                return rgba_of(image, where)
    except InputError:
        raise
    except Exception as problem:  # a decoder may raise anything
        reason = "its content is of no known kind" if isinstance(problem, UnidentifiedImageError) else problem
        raise InputError(
            where, f"not a readable image ({brief(reason)})", "Use a complete PNG, JPEG, WebP or TIFF image"
        ) from problem


def rgba_of(image: Image.Image, where: str) -> np.ndarray:
    """(h, w, 4) uint8 RGBA of a PIL image.

    Grey is repeated into the three colours, 16-bit values are divided by 257, palettes are expanded, CMYK and
    YCbCr are converted without a colour profile; without an alpha channel alpha is 255.
    """
    if max(image.size) > LARGEST_SIDE or min(image.size) < 1 or image.width * image.height > MOST_TEXELS:
        raise InputError(
            where,
            f"the texture has {image.width} x {image.height} texels",
            f"Resize it to at most {LARGEST_SIDE} a side and {MOST_TEXELS} in all",
        )
    if image.mode == "F":
        raise InputError(
            where, "the texture holds floating point values", "Save it with 8 or 16 bits a channel"
        )
    if image.mode in _SIXTEEN_BIT_MODES:
        values = np.asarray(image)
        if values.min() < 0 or values.max() > 65535:
            raise InputError(
                where, "the grey texture has more than 16 bits", "Save it with 8 or 16 bits a channel"
            )
        grey = ((values.astype(np.int32) + 128) // 257).astype(np.uint8)
        return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
    return np.array(image.convert("RGBA"), dtype=np.uint8)


def scaled_map(levels: np.ndarray, factor: float) -> np.ndarray:
    """Multiply a linear map (h, w) uint8 by a factor, clipped to 0..1, as glTF's factors ask."""
    if factor == 1.0:
        return np.ascontiguousarray(levels)
    table = np.rint(255 * np.clip(np.arange(256) / 255 * factor, 0, 1)).astype(np.uint8)
    return np.asarray(table[levels])


def scaled_normals(image: np.ndarray, scale: float) -> np.ndarray | None:
    """Scale x and y of normals (h, w, 3 or more) uint8, as glTF's `normalTexture.scale` asks.

    Returns
    -------
    ndarray or None
        (h, w, 3) uint8 unit normals; None where all are upright within half a level: there is no map.
    """
    normals = image[..., :3]
    if scale != 1.0:
        scaled = (normals / np.float32(127.5) - 1) * np.array([scale, scale, 1.0], dtype=np.float32)
        scaled /= np.maximum(np.linalg.norm(scaled, axis=-1, keepdims=True), 1e-9)
        normals = np.rint(127.5 * (scaled + 1.0)).astype(np.uint8)
    aside = np.abs(normals[..., :2].astype(np.int16) - 127)
    return None if aside.max(initial=0) <= 1 else np.ascontiguousarray(normals)


def holds_normals(image: np.ndarray) -> bool:
    """Whether an image (h, w, 4) is a map of normals in tangent space rather than of heights.

    Nearly all of its texels are unit vectors that point off the surface.
    """
    x, y, z = np.moveaxis(image[..., :3].astype(np.float32) / 127.5 - 1.0, -1, 0)
    length = np.sqrt(x * x + y * y + z * z)
    return bool(((np.abs(length - 1.0) < 0.1) & (z > 0.0)).mean() > 0.95)


def uniform_map(value: float) -> np.ndarray:
    """(1, 1) uint8 map of one value in 0..1."""
    return np.full((1, 1), round(255 * min(max(value, 0.0), 1.0)), dtype=np.uint8)


def opaque(texture: np.ndarray) -> np.ndarray:
    """Return an RGBA texture with an alpha of 255, itself where it has that."""
    if (texture[..., 3] == 255).all():
        return texture
    result = texture.copy()
    result[..., 3] = 255
    return result


def with_alpha(texture: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Return an RGBA texture with the alpha of an (h, w) uint8 image, at the larger size of the two.

    Where sizes differ the smaller one is repeated texel by texel, which changes no value; sides that are no
    multiples of each other are resampled to the nearest texel.
    """
    height, width = np.maximum(texture.shape[:2], alpha.shape)
    result = resized(texture, height, width).copy()
    result[..., 3] = resized(alpha, height, width)
    return result


def resized(image: np.ndarray, height: int, width: int) -> np.ndarray:
    """Return an image (h, w) or (h, w, c) at another size, each texel the nearest of its own."""
    rows = np.arange(height) * image.shape[0] // height
    columns = np.arange(width) * image.shape[1] // width
    return image[rows[:, None], columns]


def uniform_texture(colour: np.ndarray) -> np.ndarray:
    """(1, 1, 4) uint8 texture of one sRGB-encoded colour, (3,) or (4,) in 0..1."""
    rgba = np.ones(4)
    rgba[: len(colour)] = colour
    return np.rint(255 * np.clip(rgba, 0, 1)).astype(np.uint8).reshape(1, 1, 4)


def corner_colour_atlas(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Texture and coordinates that show colours given at face corners.

    Each face owns 2 x 2 texels: the colours of its corners and the one that makes the block affine. Bilinear
    lookup between their centres is then the linear interpolation over the triangle.

    Parameters
    ----------
    colours
        (F, 3, 4) sRGB-encoded RGBA of each corner, 0..1.

    Returns
    -------
    texture
        (2 n, 2 n, 4) uint8 with n * n >= F.
    texture_coordinates
        (F, 3, 2) float64, v up.
    """
    count = len(colours)
    side = max(1, int(np.ceil(np.sqrt(count))))
    fourth = np.clip(colours[:, 1] + colours[:, 2] - colours[:, 0], 0, 1)
    blocks = np.zeros((side * side, 2, 2, 4))
    blocks[:count, 0, 0], blocks[:count, 0, 1] = colours[:, 0], colours[:, 1]
    blocks[:count, 1, 0], blocks[:count, 1, 1] = colours[:, 2], fourth
    image = blocks.reshape(side, side, 2, 2, 4).transpose(0, 2, 1, 3, 4).reshape(2 * side, 2 * side, 4)
    row, column = np.divmod(np.arange(count), side)
    corner_texels = np.array([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]])
    texels = corner_texels + 2.0 * np.stack([column, row], axis=1)[:, None, :]
    coordinates = np.stack([texels[..., 0], 2 * side - texels[..., 1]], axis=-1) / (2 * side)
    return np.rint(255 * np.clip(image, 0, 1)).astype(np.uint8), coordinates


def srgb_encode(linear: np.ndarray) -> np.ndarray:
    """Scene-linear 0..1 to sRGB-encoded 0..1 (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def srgb_decode(encoded: np.ndarray) -> np.ndarray:
    """SRGB-encoded 0..1 to scene-linear 0..1 (IEC 61966-2-1)."""
    encoded = np.clip(encoded, 0, 1)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def tint(texture: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Multiply a texture by a scene-linear RGBA factor, as glTF's baseColorFactor asks."""
    if np.array_equal(factor, np.ones(4)):
        return texture
    levels = np.arange(256) / 255
    table = np.empty((256, 4))
    table[:, :3] = srgb_encode(srgb_decode(levels)[:, None] * factor[:3])
    table[:, 3] = levels * factor[3]
    table = np.rint(255 * np.clip(table, 0, 1)).astype(np.uint8)
    return np.stack([table[texture[..., channel], channel] for channel in range(4)], axis=-1)


class TextureReader:
    """Reads images by a key that names them, and keeps them.

    Parameters
    ----------
    where
        The mesh, for errors.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._images: dict[object, np.ndarray] = {}
        self._counted: dict[int, np.ndarray] = {}
        self._bytes = 0

    def file(self, path: Path) -> np.ndarray:
        """Read an image file as (h, w, 4) uint8 RGBA; see `read_texture`."""
        if path not in self._images:
            self._images[path] = self.count(read_texture(path))
        return self._images[path]

    def data(self, key: object, data: bytes, where: str) -> np.ndarray:
        """Decode an image file's bytes as (h, w, 4) uint8 RGBA; see `decode_texture`."""
        if key not in self._images:
            self._images[key] = self.count(decode_texture(data, where))
        return self._images[key]

    def count(self, image: np.ndarray) -> np.ndarray:
        """Return an image that the mesh will hold, counted once.

        Raises
        ------
        InputError
            It is one too many.
        """
        if id(image) not in self._counted:
            self._counted[id(image)] = image
            self._bytes += image.nbytes
            if self._bytes > TEXTURE_BYTES:
                raise InputError(
                    self._where,
                    f"its textures take more than {TEXTURE_BYTES} bytes in all",
                    "Use fewer or smaller textures",
                )
        return image
