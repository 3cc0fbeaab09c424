"""The command of stages that own folders: ``python -m pipeline.run.record STAGE [--root DIR]``.

It writes the stage's receipt, a small file behind which the last stage comes: DVC would list a folder of
thousands of products once more each time. As a rule, the stage `products` has just written the manifest, and
the folders hold what it lists. Seeing that takes this module, which imports next to nothing, a tenth of the
time of ``objectfolder record STAGE``, which does the rest.
"""

import csv
import gc
import json
import os
import re
import sys
from pathlib import Path

# A product as ``verified.json`` has it. To parse all of that file takes ten times as long as to find the
# products of a stage in it. A product that is written otherwise counts as not recorded.
PRODUCT_PATTERN = rb'"(%s/[^"\\\\]+)":\{"state":\[(\d+),(\d+),(\d+)\],"whole":\w+,"md5":"(\w+)"'


def receipt_path(stage: str) -> Path:
    """Return where the receipt of a stage lies, from the root on."""
    return Path("data", "receipts", f"{stage}.json")


def write_receipt(root: Path, stage: str) -> None:
    """Write what the manifest says of a stage, as a file of its own.

    ``data/manifest.json`` is `pipeline.dataset.manifest`'s.
    """
    entry = json.loads((root / "data" / "manifest.json").read_bytes())["stages"][stage]
    path = root / receipt_path(stage)
    path.parent.mkdir(exist_ok=True)
    path.unlink(missing_ok=True)  # it may be a link into DVC's cache
    path.write_text(json.dumps(entry, indent=1) + "\n")


def is_recorded(root: Path, stage: str) -> bool:
    """Whether all products of a stage are those of the manifest, as far as is known without reading them.

    ``data/products.csv`` is `pipeline.dataset.manifest`'s, ``verified.json`` `pipeline.dataset.verified`'s.
    """
    try:
        with open(root / "data" / "products.csv", encoding="utf-8", newline="") as file:
            lines = (line for number, line in enumerate(file) if not number or f",{stage}," in line)
            digests = {line["path"]: line["md5"] for line in csv.DictReader(lines) if line["stage"] == stage}
        digests.pop("", None)  # failures
        text = (root / ".objectfolder" / "verified.json").read_bytes()
        folders = {path.rpartition("/")[0] for path in digests}
        states = {
            path.decode(): (digest.decode(), *map(int, state))
            for folder in folders
            for path, *state, digest in re.findall(PRODUCT_PATTERN % re.escape(folder).encode(), text)
        }
        present = {
            f"{folder}/{name}"
            for folder in folders
            for name in os.listdir(root / folder)
            if not name.startswith(".")
        }
        return digests.keys() == present != set() and all(
            states[path] == (md5, *_state(root / path)) for path, md5 in digests.items()
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _state(path: Path) -> tuple[int, int, int]:
    status = os.stat(path)
    return status.st_size, status.st_mtime_ns, status.st_ino


if __name__ == "__main__":
    gc.disable()  # the collector takes half of the seconds in which the entries of 10,000 objects are read
    root = Path(sys.argv[sys.argv.index("--root") + 1]) if "--root" in sys.argv else Path.cwd()
    if is_recorded(root, sys.argv[1]):
        write_receipt(root, sys.argv[1])
    else:
        os.execv(sys.executable, [sys.executable, "-m", "pipeline.cli", "record", *sys.argv[1:]])
