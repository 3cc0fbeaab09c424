"""FBX, USD and .blend files, read by the Blender that the extra `factory` brings, in a child process."""

import importlib.util
import json
import subprocess
import tempfile
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from objectfolder.child_process import OUT_OF_TIME, last_words, run_module
from objectfolder.errors import InputError
from objectfolder.extras import missing_package
from objectfolder.making.mesh.readers.gltf import read_gltf
from objectfolder.surface.textured_mesh import TexturedMesh

BLENDER_SUFFIXES = (".fbx", ".usd", ".usda", ".usdc", ".usdz", ".blend")

PATIENCE_S = 3600


def read_with_blender(path: Path, *, with_textures: bool = True) -> TexturedMesh:
    """Read a file as Blender does: z up and in metres, by the axes and units that the file states.

    Parameters
    ----------
    with_textures
        False leaves colours out.

    Raises
    ------
    MissingPackageError
        Blender is not installed.
    InputError
        Blender cannot read it, or finds no mesh in it.
    """
    data, record = _as_gltf(*_version(path))
    with tempfile.TemporaryDirectory(prefix="objectfolder-blender-") as folder:
        converted = Path(folder) / "mesh.glb"
        converted.write_bytes(data)
        try:
            mesh = read_gltf(converted, with_textures=with_textures)
        except InputError as problem:
            raise InputError(str(path), problem.finding, problem.remedy) from problem
    remark = f"read by Blender {record['version']}, as glTF"
    return replace(
        mesh,
        vertices=mesh.vertices * record["metres"],
        remarks=(remark, *record["remarks"], *mesh.remarks),
    )


def blender_files(path: Path) -> list[Path]:
    """Return the pictures that Blender reads with a mesh; see `read_with_blender` for errors."""
    return [Path(file) for file in _as_gltf(*_version(path))[1]["files"]]


def _version(path: Path) -> tuple[Path, int, int]:
    status = path.stat()
    return path.absolute(), status.st_mtime_ns, status.st_size


@lru_cache(maxsize=1)
def _as_gltf(path: Path, _time: int, _size: int) -> tuple[bytes, dict[str, Any]]:
    """Return a binary glTF, and what `blender_process` says of it."""
    if importlib.util.find_spec("bpy") is None:
        finding = f"is not installed: it reads {path.name} on Python 3.11; elsewhere export the mesh as glTF"
        raise missing_package("bpy", "factory", finding)
    with tempfile.TemporaryDirectory(prefix="objectfolder-blender-") as folder:
        result = Path(folder) / "mesh.glb"
        try:
            done = run_module(
                "objectfolder.making.mesh.readers.blender_process", path, Path(folder), timeout_s=PATIENCE_S
            )
        except subprocess.TimeoutExpired as error:
            raise _unreadable(path, "it took too long") from error
        report = result.with_name("read.json")
        if done.returncode or not report.exists() or not result.exists():
            words = "it took too long" if done.returncode == OUT_OF_TIME else last_words(done.stderr)
            raise _unreadable(path, words)
        return result.read_bytes(), json.loads(report.read_text())


def _unreadable(path: Path, words: str) -> InputError:
    return InputError(
        str(path), f"cannot be read by Blender ({words})", "Check the file, or export it as glTF"
    )
