"""A local memo of products by fingerprint, so that a setting set back costs no computation.

It lies in ``.objectfolder/memo``, outside git and DVC. Files are copies (sharing blocks where the file
system can), so a product damaged in place leaves its memo whole. ``OBJECTFOLDER_MEMO_GB`` caps its size.
"""

import contextlib
import os
import shutil
from pathlib import Path

from objectfolder.atomic import atomic_write
from objectfolder.errors import FormatError, InputError
from pipeline import products

CAP = "OBJECTFOLDER_MEMO_GB"
DEFAULT_GB = 20.0
FICLONE = 0x40049409  # ioctl of Linux: share the blocks of another file


def memo_folder(root: Path, fingerprint: str) -> Path:
    """Return the folder of the products with this fingerprint."""
    return root / ".objectfolder" / "memo" / fingerprint[:2] / fingerprint


def remember(folder: Path, path: Path) -> None:
    """Put a copy of a product into its memo folder; a full disk loses the memo, not the product."""
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        copy_file(path, folder / memo_name(path))


def restore(folder: Path, fingerprint: str, targets: tuple[Path, ...]) -> bool:
    """Put remembered products in place; False, and nothing done, unless all are there and whole."""
    sources = [folder / memo_name(target) for target in targets]
    if not all(source.is_file() for source in sources):
        return False
    try:
        for source in sources:
            products.verify(source)
            if products.read_fingerprint(source) != fingerprint:
                return False
    except FormatError:
        shutil.rmtree(folder, ignore_errors=True)
        return False
    for source, target in zip(sources, targets, strict=True):
        copy_file(source, target)
    os.utime(folder)
    return True


def prune(root: Path) -> None:
    """Remove the memos longest unused until the rest fits the cap."""
    base = root / ".objectfolder" / "memo"
    folders = [(folder.stat().st_mtime, folder) for folder in base.glob("*/*")]
    sizes = {folder: sum(path.stat().st_size for path in folder.iterdir()) for _, folder in folders}
    excess = sum(sizes.values()) - cap_bytes()
    for _, folder in sorted(folders):
        if excess <= 0:
            break
        shutil.rmtree(folder, ignore_errors=True)
        excess -= sizes[folder]


def cap_bytes() -> int:
    """Return the cap of the memo.

    Raises
    ------
    InputError
        ``OBJECTFOLDER_MEMO_GB`` is no number.
    """
    text = os.environ.get(CAP, str(DEFAULT_GB))
    try:
        return int(float(text) * 1e9)
    except ValueError:
        raise InputError(CAP, f"{text!r} is no number", "Give gigabytes, 0 for no memo.") from None


def memo_name(path: Path) -> str:
    """Return the name of a product inside its memo folder: kind and suffix, without the object."""
    suffix = products.TENSORS if path.name.endswith(products.TENSORS) else products.ZARR
    return f"{path.parent.name}{suffix}"


def copy_file(source: Path, target: Path) -> None:
    """Copy a file atomically, by reference where the file system can."""
    with atomic_write(target) as file, open(source, "rb") as original:
        if not _clone(original.fileno(), file.fileno()):
            shutil.copyfileobj(original, file, 1 << 20)


def _clone(source: int, target: int) -> bool:
    try:
        import fcntl

        fcntl.ioctl(target, FICLONE, source)
    except (ImportError, OSError):
        return False
    return True
