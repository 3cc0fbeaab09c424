"""The images of one mesh: each read once, and not more of them than memory holds."""

from pathlib import Path

import numpy as np

from objectfolder.errors import InputError
from objectfolder.mesh.readers.textures import decode_texture, read_texture

MOST_BYTES = 2**30
"""Of all textures and maps of a mesh: 16 textures of 4096 a side."""


class TextureReader:
    """Reads images by a key that names them, and keeps them.

    Parameters
    ----------
    where
        The mesh, for errors.
    """

    def __init__(self, where: str) -> None:
        self._where = where
        self._known: dict[object, np.ndarray] = {}
        self._counted: dict[int, np.ndarray] = {}
        self._bytes = 0

    def file(self, path: Path) -> np.ndarray:
        """Read an image file as (h, w, 4) uint8 RGBA; see `textures.read_texture`."""
        if path not in self._known:
            self._known[path] = self.count(read_texture(path))
        return self._known[path]

    def data(self, key: object, data: bytes, where: str) -> np.ndarray:
        """Decode an image file's bytes as (h, w, 4) uint8 RGBA; see `textures.decode_texture`."""
        if key not in self._known:
            self._known[key] = self.count(decode_texture(data, where))
        return self._known[key]

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
            if self._bytes > MOST_BYTES:
                raise InputError(
                    self._where,
                    f"its textures take more than {MOST_BYTES} bytes in all",
                    "Use fewer or smaller textures",
                )
        return image
