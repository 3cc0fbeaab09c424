"""The command of stages that own folders: ``python -m pipeline.run.record STAGE [--root DIR]``.

As a rule, the stage `products` has just written the manifest, and the folders hold what it lists. Seeing that
takes this module, which imports next to nothing, a tenth of the time of ``objectfolder record STAGE``, which
does the rest.
"""

import csv
import gc
import json
import os
import sys
from pathlib import Path


def is_recorded(root: Path, stage: str) -> bool:
    """Whether all products of a stage are those of the manifest, as far as is known without reading them.

    ``data/products.csv`` is `pipeline.dataset.manifest`'s, ``verified.json`` `pipeline.dataset.verified`'s.
    """
    try:
        with open(root / "data" / "products.csv", encoding="utf-8", newline="") as file:
            lines = (line for number, line in enumerate(file) if not number or f",{stage}," in line)
            listed = {line["path"]: line["md5"] for line in csv.DictReader(lines) if line["stage"] == stage}
        known = json.loads((root / ".objectfolder" / "verified.json").read_bytes())["products"]
        listed.pop("", None)  # failures
        present = {
            f"{folder}/{name}"
            for folder in {path.rpartition("/")[0] for path in listed}
            for name in os.listdir(root / folder)
            if not name.startswith(".")
        }
        return listed.keys() == present != set() and all(
            known[path]["md5"] == md5 and known[path]["state"] == _state(root / path)
            for path, md5 in listed.items()
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _state(path: Path) -> list[int]:
    status = os.stat(path)
    return [status.st_size, status.st_mtime_ns, status.st_ino]


if __name__ == "__main__":
    gc.disable()  # the collector takes half of the seconds in which the entries of 10,000 objects are read
    root = Path(sys.argv[sys.argv.index("--root") + 1]) if "--root" in sys.argv else Path.cwd()
    if not is_recorded(root, sys.argv[1]):
        os.execv(sys.executable, [sys.executable, "-m", "pipeline.cli", "record", *sys.argv[1:]])
