"""The real stages over toy bodies, with versions of what they make in git and in DVC's formats."""

import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from workshop import Workshop

from pipeline.audit.comparison import Comparison
from pipeline.audit.contents import Contents
from pipeline.audit.findings import Audit, ObjectChange
from pipeline.audit.versions import Version, read_version
from pipeline.dataset.records import read_table, write_records

# Fidelity that follows from what the object was made from, for there to be something to compare.
FIDELITY_BODY = '''
"""Two products, and measures of them."""

import numpy as np

from objectfolder.products.store import read_product
from objectfolder.products.tensor_file import TensorFile

from .counting import executed, product


def run(request):
    executed("fidelity", request)
    views, modes = (float(read_product(request.inputs[name])["values"][0]) for name in ("views", "modes"))
    tensors = {"weights": np.arange(5, dtype=np.float16)}
    measures = {
        "vision": {"psnr_db": 40.0 + views / 10, "ssim": 0.98},
        "audio": {"gain_error_db": -40.0 - modes / 10},
        "touch": {"psnr_contact_db": 50.0},
        "bytes": {"total": 1000.0},
    }
    return TensorFile(tensors, {"name": request.record["name"]}), product(1, **measures)
'''
IGNORED = """\
/data/objects/
/data/views/
/data/modes/
/data/touches/
/data/collision/
/data/encoded/
/data/object_files/
/data/fidelity/
/.objectfolder/
/runs/
/executed.log
__pycache__/
/.dvc/cache/
/.dvc/tmp/
"""
GIT = {
    "GIT_AUTHOR_NAME": "t",
    "GIT_AUTHOR_EMAIL": "t@t",
    "GIT_COMMITTER_NAME": "t",
    "GIT_COMMITTER_EMAIL": "t@t",
    "GIT_CONFIG_GLOBAL": os.devnull,
}


class VersionedWorkshop(Workshop):
    """A workshop whose state can be kept as a version.

    Versions are written in DVC's documented formats, which takes no process of DVC; that DVC writes them so
    is a test of its own.
    """

    def __init__(self, root: Path, package: str) -> None:
        super().__init__(root, package)
        (self.bodies / "fidelity.py").write_text(FIDELITY_BODY)
        (root / ".dvc").mkdir()
        (root / ".dvc" / "config").write_text("[core]\n    analytics = false\n")
        (root / ".gitignore").write_text(IGNORED)
        self.git("init", "-q", "-b", "main", "--template=")

    def git(self, *arguments: str) -> str:
        """Run git in the checkout."""
        done = subprocess.run(
            ["git", *arguments], cwd=self.root, capture_output=True, text=True, check=True,
            env={**os.environ, **GIT},
        )  # fmt: skip
        return done.stdout.strip()

    def version(self, message: str = "a version", make: bool = True) -> str:
        """Make what is left, keep it as a version, and return its commit."""
        if make:
            self.converge()
        self.lock()
        self.git("add", "-A")
        self.git("commit", "-q", "--allow-empty", "-m", message)
        return self.git("rev-parse", "HEAD")

    @property
    def first(self) -> str:
        """The first version."""
        return self.git("rev-list", "--max-parents=0", "HEAD")

    def lock(self) -> None:
        """Write ``data/records.json`` and ``dvc.lock``, and keep all products in the cache."""
        parameters = self.parameters
        write_records(self.root, read_table(self.root, parameters.objects))
        said = {"seed": parameters.seed, "objects": {"table": parameters.objects.table, "only": []}}
        stages = {
            stage.name: {
                "cmd": f"make {stage.name}",
                "params": {"params.yaml": said},
                "outs": [self._kept(kind.folder) for kind in stage.products],
            }
            for stage in self.stages
        }
        (self.root / "dvc.lock").write_text(yaml.safe_dump({"schema": "2.0", "stages": stages}))

    def declare(self) -> None:
        """Let DVC know the stages of ``dvc.lock``."""
        locked = yaml.safe_load((self.root / "dvc.lock").read_text())["stages"]
        stages = {
            name: {"cmd": stage["cmd"], "outs": [out["path"] for out in stage["outs"]]}
            for name, stage in locked.items()
        }
        (self.root / "dvc.yaml").write_text(yaml.safe_dump({"stages": stages}))

    def _kept(self, folder: str) -> dict[str, object]:
        files = sorted(path for path in (self.root / folder).iterdir() if not path.name.startswith("."))
        entries = [{"md5": self.keep(path.read_bytes()), "relpath": path.name} for path in files]
        listing = self.keep(json.dumps(entries).encode(), ".dir")
        sizes = sum(path.stat().st_size for path in files)
        return {"path": folder, "hash": "md5", "md5": listing, "size": sizes, "nfiles": len(files)}

    def keep(self, content: bytes, suffix: str = "") -> str:
        """Put a content into the cache, and return its hash."""
        md5 = hashlib.md5(content).hexdigest() + suffix
        path = self.cached(md5)
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        return md5

    def cached(self, md5: str) -> Path:
        """Where the cache has a content."""
        return self.root / ".dvc" / "cache" / "files" / "md5" / md5[:2] / md5[2:]

    def in_cache(self, path: Path) -> Path:
        """Where the cache has the content of a file."""
        return self.cached(hashlib.md5(path.read_bytes()).hexdigest())

    def audit(self, old: str, new: str | None = None, arrays: bool = False, remote: str = "") -> Audit:
        """Compare two versions, or one and the work tree."""
        with Contents(self.root, remote) as contents:
            before, after = self.at(contents, old), self.at(contents, new)
            return Comparison(contents, before, after, self.stages, arrays).audit()

    def at(self, contents: Contents, revision: str | None) -> Version:
        """A version, or the work tree."""
        return read_version(contents, self.stages, revision)


@contextmanager
def made_versions(folder: Path, package: str, **materials: str) -> Iterator[VersionedWorkshop]:
    """A checkout with one version, made and remembered: objects by their materials."""
    root = folder / "checkout"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(root))
        workshop = VersionedWorkshop(root, package)
        for object_id, material in materials.items():
            workshop.add(object_id, material)
        workshop.version("first")
        workshop.remember()
        yield workshop


def only(audit: Audit, object_id: str) -> ObjectChange:
    """What became of one object."""
    (change,) = (candidate for candidate in audit.objects if candidate.object_id == object_id)
    return change


def states(audit: Audit) -> dict[str, str]:
    """State by object."""
    return {change.object_id: change.state for change in audit.objects}


def flip(path: Path, bit: int) -> None:
    """Flip a bit of a file that may be shared with nobody."""
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    if path.is_symlink() or path.stat().st_nlink > 1:
        path.unlink()
    path.write_bytes(data)


def emptied(folder: Path) -> None:
    """Remove what a folder holds."""
    shutil.rmtree(folder)
    folder.mkdir()
