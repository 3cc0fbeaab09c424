"""A memo of products by fingerprint, so that no product is made twice.

It lies in ``.objectfolder/memo``, outside git and DVC. Files are copies (sharing blocks where the file
system can), so a product damaged in place leaves its memo whole. ``OBJECTFOLDER_MEMO_GB`` caps its size.
Behind it may stand a shared store (`pipeline.store.shared`), from which what is not here is taken, and which
gets what is made here.
"""

import contextlib
import os
import shutil
from pathlib import Path

from objectfolder.errors import FormatError
from pipeline.dataset import products
from pipeline.dataset.state import STATE
from pipeline.store import shared
from pipeline.store.copying import copy_file
from pipeline.store.storage import Store, disk_error, number_of, product_name

CAP = "OBJECTFOLDER_MEMO_GB"
DEFAULT_GB = 20.0


def memo_base(root: Path) -> Path:
    """Return the folder of the memo of a data set.

    A copy in which DVC runs an experiment (``dvc exp run --temp``) has the memo of its original.
    """
    parents = root.parents
    in_copy = len(parents) > 3 and [folder.name for folder in parents[:3]] == ["exps", "tmp", ".dvc"]
    return (parents[3] if in_copy else root) / STATE / "memo"


def memo_folder(root: Path, fingerprint: str) -> Path:
    """Return the folder of the products with this fingerprint."""
    return memo_base(root) / fingerprint[:2] / fingerprint


def remember(folder: Path, path: Path) -> None:
    """Put a copy of a product into its memo folder, and into the shared store if there is one.

    A full disk or a store out of reach loses the copy, not the product.
    """
    with contextlib.suppress(OSError):
        copy_file(path, folder / memo_name(path))
    shared.share(folder.parents[2], product_name(folder.name, memo_name(path)), path)


def restore(folder: Path, fingerprint: str, targets: tuple[Path, ...]) -> bool:
    """Put remembered products in place; False, and nothing done, unless all are there and whole.

    Raises
    ------
    InputError
        A shared store that cannot be used as it is named, or a folder that cannot be written.
    SimulationError
        The disk is full.
    """
    sources = _sources(folder, targets)
    if not _whole(sources, fingerprint):
        stored = _stored(folder, targets)
        if not shared.fetch(stored, sources):
            return False
        if not _whole(sources, fingerprint):
            shared.discard(stored)
            return False
    _place(sources, targets)
    return True


def take(folder: Path, fingerprint: str, targets: tuple[Path, ...], store: Store) -> bool:
    """Put products into place from a store, and remember them; False unless all are there and whole.

    Raises
    ------
    InputError, SimulationError
        The store or the disk cannot be used.
    """
    sources = _sources(folder, targets)
    if not _whole(sources, fingerprint):
        stored = _stored(folder, targets)
        if not all(store.get(name, source) for name, source in zip(stored, sources, strict=True)):
            return False
        if not _whole(sources, fingerprint):
            return False
    _place(sources, targets)
    return True


def prune(root: Path) -> None:
    """Remove the memos longest unused until the rest fits the cap; share what could not be shared before."""
    base = memo_base(root)
    shared.settle(base.parent)
    folders, sizes = [], {}
    for folder in base.glob("*/*"):
        with contextlib.suppress(OSError):  # another run prunes too
            sizes[folder] = sum(path.stat().st_size for path in folder.iterdir())
            folders.append((folder.stat().st_mtime, folder))
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
    return int(1e9 * number_of(CAP, DEFAULT_GB))


def memo_name(path: Path) -> str:
    """Return the name of a product inside its memo folder: kind and suffix, without the object."""
    suffix = products.TENSORS if path.name.endswith(products.TENSORS) else products.ZARR
    return f"{path.parent.name}{suffix}"


def check_product(path: Path, fingerprint: str) -> None:
    """Raise FormatError unless a product is whole and has this fingerprint."""
    products.verify(path)
    if products.read_fingerprint(path) != fingerprint:
        finding = "another fingerprint than its name says"
        raise FormatError(str(path), finding, "Delete it; a run makes it again.")


def _sources(folder: Path, targets: tuple[Path, ...]) -> list[Path]:
    return [folder / memo_name(target) for target in targets]


def _stored(folder: Path, targets: tuple[Path, ...]) -> list[str]:
    return [product_name(folder.name, memo_name(target)) for target in targets]


def _whole(sources: list[Path], fingerprint: str) -> bool:
    """Whether all products are there and whole; removes the memo of a damaged one."""
    if not all(source.is_file() for source in sources):
        return False
    try:
        for source in sources:
            check_product(source, fingerprint)
    except FormatError:
        shutil.rmtree(sources[0].parent, ignore_errors=True)
        return False
    return True


def _place(sources: list[Path], targets: tuple[Path, ...]) -> None:
    for source, target in zip(sources, targets, strict=True):
        try:
            copy_file(source, target)
        except OSError as error:
            raise disk_error(error, target.parent) from error
    with contextlib.suppress(OSError):
        os.utime(sources[0].parent)
