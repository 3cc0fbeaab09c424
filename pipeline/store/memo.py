"""A memo of products by fingerprint, so that no product is made twice.

It lies in ``.objectfolder/memo``, outside git and DVC. Files are copies (sharing blocks where the file
system can), so a product damaged in place leaves its memo whole. ``OBJECTFOLDER_MEMO_GB`` caps its size.
Behind it may stand a shared store (`pipeline.store.shared`), from which what is not here is taken, and which
gets what is made here.
"""

import contextlib
import os
import shutil
from collections.abc import Iterable
from pathlib import Path

from objectfolder.errors import FormatError
from pipeline.dataset import products
from pipeline.dataset.validation import number_of
from pipeline.store import shared
from pipeline.store.storage import Store, copy_file, disk_error, excess, product_name

CAP = "OBJECTFOLDER_MEMO_GB"
DEFAULT_GB = 20.0


def memo_base(root: Path) -> Path:
    """Return the folder of the memo of a data set.

    A copy in which DVC runs an experiment (``dvc exp run --temp``) has the memo of its original.
    """
    parents = root.parents
    in_copy = len(parents) > 3 and [folder.name for folder in parents[:3]] == ["exps", "tmp", ".dvc"]
    return (parents[3] if in_copy else root) / products.STATE / "memo"


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


def restore(folder: Path, targets: tuple[Path, ...], store: Store | None = None) -> bool:
    """Put remembered products in place; False, and nothing done, unless all are there and whole.

    Parameters
    ----------
    folder
        Of the products in the memo (`memo_folder`).
    targets
        Where they belong.
    store
        From which they are taken where the memo lacks them; None for the shared store, if there is one.

    Raises
    ------
    InputError
        A store that cannot be used as it is named, or a folder that cannot be written.
    SimulationError
        The disk is full, or `store` fails.
    """
    sources = [folder / memo_name(target) for target in targets]
    names = [product_name(folder.name, memo_name(target)) for target in targets]
    if not _whole(sources, folder.name):
        found = store.get_all(names, sources) if store else shared.fetch(names, sources)
        if not found:
            return False
        if not _whole(sources, folder.name):
            if store is None:
                shared.discard(names)
            return False
    for source, target in zip(sources, targets, strict=True):
        try:
            copy_file(source, target)
        except OSError as error:
            raise disk_error(error, target.parent) from error
    with contextlib.suppress(OSError):
        os.utime(folder)
    return True


def prune(root: Path) -> None:
    """Remove the memos longest unused until the rest fits the cap; share what could not be shared before."""
    base = memo_base(root)
    shared.settle(base.parent)
    found = []
    for folder in base.glob("*/*"):
        with contextlib.suppress(OSError):  # another run prunes too
            size = sum(path.stat().st_size for path in folder.iterdir())
            found.append((folder.stat().st_mtime, size, folder))
    for folder in excess(found, int(1e9 * number_of(CAP, DEFAULT_GB))):
        shutil.rmtree(folder, ignore_errors=True)


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


def are_whole(paths: Iterable[Path], fingerprint: str) -> bool:
    """Return whether all products are there, whole and with this fingerprint."""
    try:
        for path in paths:
            check_product(path, fingerprint)
    except (OSError, FormatError):
        return False
    return True


def _whole(sources: list[Path], fingerprint: str) -> bool:
    """Whether all products are there and whole; removes the memo of a damaged one."""
    if not all(source.is_file() for source in sources):
        return False
    whole = are_whole(sources, fingerprint)
    if not whole:
        shutil.rmtree(sources[0].parent, ignore_errors=True)
    return whole
