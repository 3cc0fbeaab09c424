"""Earlier products in DVC's cache, found by what they were made from, so that none is made twice.

DVC names files by their content. ``.objectfolder/products.csv`` says which fingerprint has which content: a
line for each product that a manifest in this checkout ever listed. What DVC's cache lacks may come from a
shared store (`pipeline.store.shared`).
"""

import configparser
import functools
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from objectfolder.products.regular_file import read_regular, require_regular
from pipeline.dataset import products
from pipeline.dataset.manifest import Entry
from pipeline.store import shared
from pipeline.store.storage import copy_file, disk_error, product_name

INDEX = Path(products.STATE) / "products.csv"
COPIES = (".dvc", "tmp", "exps")  # where DVC keeps the copies
LINE = re.compile(r"([0-9a-f]{64}),([a-z_]+\.[a-z.]+),([0-9a-f]{32})")


class ProductCache:
    """DVC's cache of the data set at `root`.

    A copy in which DVC runs an experiment (``dvc exp run --temp``) has the cache of its original.
    """

    def __init__(self, root: Path) -> None:
        parts = root.parts
        copies = [place for place in range(len(parts) - 3) if parts[place : place + 3] == COPIES]
        self._root = Path(*parts[: copies[-1]], *parts[copies[-1] + 4 :]) if copies else root
        checkouts = (self._root, *self._root.parents)  # a partition lies below its checkout
        self._own = next((path for path in checkouts if (path / ".dvc").is_dir()), self._root) / ".dvc"

    def path(self, md5: str) -> Path:
        """Return where a file with this content lies, if the cache has it."""
        return self._folder / md5[:2] / md5[2:]

    def add(self, entries: Iterable[Entry]) -> None:
        """Note products of a manifest, which DVC has in its cache, or will take into it."""
        digests = {
            (entry.fingerprint, products.kind_name(entry.path)): entry.md5 for entry in entries if entry.path
        }
        new = {name: md5 for name, md5 in digests.items() if self._index.get(name) != md5}
        lines = [f"{fingerprint},{name},{md5}\n" for (fingerprint, name), md5 in new.items()]
        self._index.update(new)
        if lines:
            (self._root / INDEX).parent.mkdir(exist_ok=True)
            if (self._root / INDEX).exists():
                require_regular(self._root / INDEX)
            with (self._root / INDEX).open("a", encoding="ascii") as file:
                file.write("".join(lines))

    def files(self, fingerprint: str, targets: Sequence[Path]) -> list[Path]:
        """Return the cached files of the products that belong to `targets`; none unless all are there."""
        names = ((fingerprint, products.kind_name(target)) for target in targets)
        files = [self.path(self._index[name]) for name in names if name in self._index]
        return files if len(files) == len(targets) and all(path.is_file() for path in files) else []

    def restore(self, fingerprint: str, targets: Sequence[Path]) -> bool:
        """Put products in place from DVC's cache, or the shared store; False unless all are there and whole.

        Damaged copies are removed.

        Raises
        ------
        InputError
            A store that cannot be used as it is named, or a folder that cannot be written.
        SimulationError
            The disk is full.
        """
        cached = self.files(fingerprint, targets)
        faults = [path for path in cached if products.md5_of(path) != "".join(path.parts[-2:])]
        for path in faults:
            path.unlink()
        if cached and not faults:
            for source, target in zip(cached, targets, strict=True):
                try:
                    copy_file(source, target)
                except OSError as error:
                    raise disk_error(error, target.parent) from error
            return True
        names = [product_name(fingerprint, products.kind_name(target)) for target in targets]
        if not shared.fetch(names, targets):
            return False
        if not products.are_whole(targets, fingerprint):
            shared.discard(names)
            return False
        return True

    @functools.cached_property
    def _index(self) -> dict[tuple[str, str], str]:
        """MD5 by fingerprint and name; a line that a kill cut short is passed over."""
        try:
            lines = read_regular(self._root / INDEX).decode("ascii", "replace").splitlines()
        except FileNotFoundError:
            return {}
        matches = filter(None, map(LINE.fullmatch, lines))
        return {(match[1], match[2]): match[3] for match in matches}

    @functools.cached_property
    def _folder(self) -> Path:
        config = configparser.ConfigParser(interpolation=None)
        config.read([self._own / "config", self._own / "config.local"], encoding="utf-8")
        return self._own / config.get("cache", "dir", fallback="cache") / "files" / "md5"
