"""What every export is made of: a credit, a folder that appears whole, JSON, and images for others."""

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.products.atomic import PARTIAL
from objectfolder.vision.compositing import srgb_encode

MANIFEST = "export.json"
NOT_KNOWN = "not stated"
EXR_FLAG = "OPENCV_IO_ENABLE_OPENEXR"


@dataclass(frozen=True)
class Credit:
    """Name, source, licence and attribution of an object, as its catalogue has them."""

    object_id: str
    name: str = ""
    source: str = NOT_KNOWN
    licence: str = NOT_KNOWN
    attribution: str = NOT_KNOWN

    @classmethod
    def of_record(cls, object_id: str, record: Mapping[str, Any] | None) -> "Credit":
        """Return what a catalogue row or an Object File's description says; the rest is not stated."""
        known = {
            key: str((record or {}).get(key) or "") for key in ("name", "source", "licence", "attribution")
        }
        name = known.pop("name") or object_id
        return cls(object_id, name, **{key: value or NOT_KNOWN for key, value in known.items()})

    def to_dict(self) -> dict[str, str]:
        """Return the credit as JSON."""
        return asdict(self)

    def to_text(self) -> str:
        """Return the text of ``ATTRIBUTION.txt``."""
        return (
            f"object       {self.name} ({self.object_id})\n"
            f"source       {self.source}\n"
            f"licence      {self.licence}\n"
            f"attribution  {self.attribution}\n"
            "The files of this folder are derived from the object named here; its licence covers them.\n"
        )


@contextlib.contextmanager
def new_folder(path: Path | str, *, overwrite: bool = False) -> Iterator[Path]:
    """Yield an empty folder to fill; it takes the name `path` when the block ends without an error.

    An error inside leaves what was at `path` before, and nothing else.

    Parameters
    ----------
    path
        The folder to make. An empty folder there is replaced.
    overwrite
        Replace an earlier export, too.

    Raises
    ------
    InputError
        A file, an earlier export that may not be overwritten, or a folder that is not an export.
    """
    path = Path(path)
    if path.exists() and not path.is_dir():
        raise InputError(str(path), "is a file", "Name a folder that does not exist yet.")
    if path.is_dir() and any(path.iterdir()):
        if not (path / MANIFEST).is_file():
            raise InputError(
                str(path), f"holds files but no {MANIFEST}, so it is no export", "Name another folder."
            )
        if not overwrite:
            raise InputError(str(path), "holds an export", "Name another folder, or ask to overwrite it.")
    path.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=PARTIAL, dir=path.parent))
    try:
        made = work / "new"
        made.mkdir()
        yield made
        if path.exists():
            path.rename(work / "old")
        made.rename(path)
    finally:
        if (work / "old").exists() and not path.exists():
            (work / "old").rename(path)
        shutil.rmtree(work)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON with a line end; equal contents give equal bytes.

    Raises
    ------
    ValueError
        A number that JSON cannot hold.
    """
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )


def straight_srgb(rgba: np.ndarray) -> np.ndarray:
    """Return (..., 4) uint8 sRGB with straight alpha of scene-linear premultiplied RGBA.

    Blended over white as the web does it (encoded values, by alpha) this is `compositing.on_white` to within
    the rounding of 8 bits. Colour is 0 where alpha is.
    """
    values = np.asarray(rgba, dtype=np.float64)
    alpha = np.clip(values[..., 3:], 0.0, 1.0)
    colour = np.divide(values[..., :3], alpha, out=np.zeros_like(values[..., :3]), where=alpha > 0)
    return np.round(np.concatenate([srgb_encode(colour), alpha], axis=-1) * 255.0).astype(np.uint8)


def write_png(path: Path, rgba: np.ndarray) -> None:
    """Write (h, w, 4) scene-linear premultiplied RGBA as 8-bit sRGB PNG with straight alpha."""
    Image.fromarray(straight_srgb(rgba), "RGBA").save(path, compress_level=6)


def write_exr(path: Path, rgba: np.ndarray) -> None:
    """Write (h, w, 4) float16 scene-linear premultiplied RGBA as OpenEXR of half floats: nothing is lost.

    Raises
    ------
    MissingPackageError
        OpenCV is not installed.
    InputError
        OpenCV was used in this process before its OpenEXR support was switched on.
    """
    os.environ.setdefault(EXR_FLAG, "1")
    with needs_extra("factory"):
        import cv2
    values = np.ascontiguousarray(rgba[..., [2, 1, 0, 3]], dtype=np.float32)
    half = [cv2.IMWRITE_EXR_TYPE, cv2.IMWRITE_EXR_TYPE_HALF]
    try:
        written = cv2.imwrite(str(path), values, half)
    except cv2.error as error:
        raise InputError(
            str(path), f"OpenCV does not write OpenEXR ({str(error).strip().splitlines()[0]})",
            f"Set {EXR_FLAG}=1 before the program starts, or leave EXR out.",
        ) from error  # fmt: skip
    if not written:
        raise InputError(str(path), "OpenCV wrote no file", "Check that there is room on the disk.")
