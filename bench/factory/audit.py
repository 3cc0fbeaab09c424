"""CPU seconds of an audit of two versions of a thousand objects, its parts, and what reading the arrays adds.

Run as ``python -m bench audit --products data``: the attributes and the lists of entries of a
finished data set's products are taken as they are, so that each file has as many entries and says as much as
a real one; chunks hold a few bytes each. Versions differ in 1, 100 and all objects. Cold is a process of its
own without any cache of attributes; the files are in the system's cache of disks, as processor time is what
is measured.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import yaml

from bench.record import REPOSITORY, arguments, conclude, cpu_seconds
from objectfolder.products.provenance import fingerprint
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, to_bytes
from pipeline.audit.reasons import BESIDE
from pipeline.dataset.products import TENSORS, ProductKind
from pipeline.dataset.stages import STAGES

CHANGED = (1, 100, 0)  # objects; 0 for all
KINDS = [kind for stage in STAGES.values() for kind in stage.products]


class VersionedProducts:
    """Products of many objects in the cache of a repository, a version after the other.

    Parameters
    ----------
    root
        A new folder.
    products
        ``data`` of a finished data set.
    count
        Objects.
    """

    def __init__(self, root: Path, products: Path, count: int) -> None:
        self.root = root
        self._bases = sorted(path.name.removesuffix(".zarr.zip") for path in (products / "objects").iterdir())
        self._ids = [f"{self._bases[index % len(self._bases)]}-{index:04d}" for index in range(count)]
        self._templates = {
            (kind.name, base, variant): Template(kind, products / kind.name / f"{base}{kind.suffix}", variant)
            for kind in KINDS
            for base in self._bases
            for variant in (0, 1)
        }
        self._entries: dict[str, dict[str, str]] = {kind.folder: {} for kind in KINDS}
        self._prints: dict[tuple[str, str], Any] = {}
        (root / ".dvc").mkdir(parents=True)
        (root / ".dvc" / "config").write_text("[core]\n    analytics = false\n")
        (root / "data").mkdir()
        self._git("init", "-q", "--template=")
        for index, object_id in enumerate(self._ids):
            self._make(object_id, self._bases[index % len(self._bases)], 0)

    def change(self, count: int) -> str:
        """Make all products of some objects from another seed; return the commit."""
        before = {path: dict(entries) for path, entries in self._entries.items()}
        for index, object_id in enumerate(self._ids[:count] if count else self._ids):
            self._make(object_id, self._bases[index % len(self._bases)], 1)
        commit = self.commit(1)
        self._entries = before
        return commit

    def commit(self, seed: int) -> str:
        """Keep what there is as a version; return the commit."""
        stages: dict[str, Any] = {}
        for stage in STAGES.values():
            outs = []
            for kind in stage.products:
                listed = sorted(self._entries[kind.folder].items())
                text = json.dumps([{"md5": md5, "relpath": name} for name, md5 in listed]).encode()
                md5 = self._keep(text, ".dir")
                outs.append({"path": kind.folder, "hash": "md5", "md5": md5, "nfiles": len(listed)})
            stages[stage.name] = {"cmd": stage.name, "params": {"params.yaml": {"seed": seed}}, "outs": outs}
        (self.root / "dvc.lock").write_text(yaml.safe_dump({"schema": "2.0", "stages": stages}))
        records = {"objects": {object_id: {} for object_id in self._ids}, "refused": []}
        (self.root / "data" / "records.json").write_text(json.dumps(records))
        self._git("add", "dvc.lock", "data/records.json")
        self._git("-c", "user.name=b", "-c", "user.email=b@b", "commit", "-q", "-m", f"seed {seed}")
        return self._git("rev-parse", "HEAD")

    def _make(self, object_id: str, base: str, seed: int) -> None:
        prints: dict[str, Any] = {}
        for stage in STAGES.values():
            for kind in stage.products:
                template = self._templates[kind.name, base, seed]
                data, prints[kind.name] = template.filled(object_id, seed, prints)
                self._entries[kind.folder][f"{object_id}{kind.suffix}"] = self._keep(data)

    def _keep(self, data: bytes, suffix: str = "") -> str:
        md5 = hashlib.md5(data).hexdigest() + suffix
        path = self.root / ".dvc" / "cache" / "files" / "md5" / md5[:2] / md5[2:]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        return md5

    def _git(self, *arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=self.root, capture_output=True, text=True, check=True)
        return done.stdout.strip()


class Template:
    """A real product with chunks of a few bytes.

    Parameters
    ----------
    kind
        What it is.
    path
        The real one.
    variant
        Chunks of two variants differ.
    """

    def __init__(self, kind: ProductKind, path: Path, variant: int) -> None:
        self._kind = kind
        self._archive = b""
        if kind.suffix == TENSORS:
            content = read_tensor_file(path)
            self._attributes: dict[str, Any] = dict(content.metadata)
            self._tensors = {name: array.reshape(-1)[:4] for name, array in content.tensors.items()}
            self._parts = json.loads(self._attributes["provenance"])
            return
        with tempfile.TemporaryFile() as file:
            with zipfile.ZipFile(path) as old, zipfile.ZipFile(file, "w", zipfile.ZIP_STORED) as new:
                for entry in old.infolist():
                    if entry.filename == "zarr.json":
                        self._attributes = json.loads(old.read(entry))["attributes"]
                    elif entry.filename.endswith("zarr.json"):
                        new.writestr(zipfile.ZipInfo(entry.filename), old.read(entry))
                    else:
                        chunk = hashlib.md5(f"{entry.filename} {variant}".encode()).digest()
                        new.writestr(zipfile.ZipInfo(entry.filename), chunk)
            file.seek(0)
            self._archive = file.read()
        self._parts = self._attributes["provenance"]

    def filled(self, object_id: str, seed: int, prints: dict[str, Any]) -> tuple[bytes, str]:
        """Return the bytes of an object's product, and its fingerprint."""
        parts = {key: part for key, part in self._parts.items() if key not in BESIDE}
        parts["seed"] = int.from_bytes(hashlib.md5(f"{object_id} {seed}".encode()).digest()[:3], "big")
        parts["inputs"] = {
            name: prints.get(name, said) if isinstance(said, str) else said
            for name, said in parts["inputs"].items()
        }
        fingerprint_now = fingerprint(parts)
        provenance = {**parts, "tolerances": self._parts.get("tolerances", {})}
        said = {**self._attributes, "fingerprint": fingerprint_now, "provenance": provenance}
        if isinstance(said.get("vision"), dict) and "psnr_db" in said["vision"]:
            said["vision"] = {**said["vision"], "psnr_db": said["vision"]["psnr_db"] - seed}
        if self._kind.suffix == TENSORS:
            return to_bytes(TensorFile(self._tensors, said)), fingerprint_now
        with tempfile.SpooledTemporaryFile(max_size=1 << 24) as file:
            file.write(self._archive)
            with zipfile.ZipFile(file, "a", zipfile.ZIP_STORED) as archive:
                text = json.dumps({"attributes": said, "zarr_format": 3, "node_type": "group"})
                archive.writestr(zipfile.ZipInfo("zarr.json"), text)
            file.seek(0)
            return file.read(), fingerprint_now


def audited(root: Path, *arguments: str) -> tuple[float, dict[str, int]]:
    """Return the CPU seconds of an audit as a user runs it, children and all, and objects by state."""
    command = "import sys; from pipeline.cli import main; sys.exit(main(sys.argv[1:]))"
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "DVC_NO_ANALYTICS": "1"}
    environment["DVC_SITE_CACHE_DIR"] = str(root / "site")  # where descriptions of what is far are kept
    start = cpu_seconds()
    done = subprocess.run(
        [sys.executable, "-c", command, "audit", *arguments],
        cwd=root, capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    seconds = cpu_seconds() - start
    counts: dict[str, int] = {}
    if "--json" in arguments:
        for entry in json.loads(done.stdout)["objects"]:
            counts[entry["state"]] = counts.get(entry["state"], 0) + 1
    return seconds, counts


def measure(root: Path, base: str, head: str, rounds: int) -> dict[str, Any]:
    """Return the CPU seconds of one comparison: from the cache, from a remote, and from it again."""
    cache, store = root / ".dvc" / "cache", root / "store"
    _, counts = audited(root, base, head, "--json")
    row: dict[str, Any] = {"states": counts}
    row["text_cpu_s"] = sorted(audited(root, base, head)[0] for _ in range(rounds))
    row["json_cpu_s"] = audited(root, base, head, "--json")[0]
    row["html_cpu_s"] = audited(root, base, head, "--html", str(root / "page.html"), "--overwrite")[0]
    cache.rename(store)
    (root / ".dvc" / "config").write_text(
        "[core]\n    analytics = false\n    remote = store\n['remote \"store\"']\n    url = ../store\n"
    )
    shutil.rmtree(root / "site", ignore_errors=True)
    row["remote_cold_cpu_s"] = audited(root, base, head)[0]
    row["remote_warm_cpu_s"] = audited(root, base, head)[0]
    store.rename(cache)
    return row


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--products", type=Path, default=Path("data"), help="data of a finished data set")
    parser.add_argument("--objects", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="objectfolder-bench-") as folder:
        data_set = VersionedProducts(Path(folder) / "set", options.products, options.objects)
        base = data_set.commit(0)
        rows = []
        for count in CHANGED:
            row = measure(data_set.root, base, data_set.change(count), options.rounds)
            rows.append({"changed": count or options.objects, **row})
            print(json.dumps(rows[-1]))
        nothing = sorted(audited(data_set.root, base, base)[0] for _ in range(options.rounds))
    figures = {"nothing_changed_cpu_s": nothing, "changed": rows}
    settings = {"objects": options.objects, "rounds": options.rounds, "products": len(KINDS)}
    compared = (
        "CPU seconds of `objectfolder audit A B`, interpreter and imports included, where all products of"
        " some objects changed; bar: 5"
    )
    conclude("audit", figures, settings, compared)
