"""A table with objects at rest on it, as a scene that refers to the objects' own files."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.simulators.formats import FORMATS, number, numbers, write_xml

Floats = NDArray[np.float64]
TABLE_THICKNESS_M = 0.04
TABLE_COLOUR = (0.55, 0.45, 0.36, 1.0)
# The plane's own friction: least, where a simulator takes the larger of two bodies, and the objects' decides.
LEAST_FRICTION = 0.01
# What `objectfolder play` shows the scene in.
LOOK = {"environment": "studio", "surroundings": "warm"}
SUFFIXES = {".xml": "mjcf", ".sdf": "sdf", ".usda": "usd"}


def write_scene(
    path: Path, names: Sequence[str], poses: Sequence[Floats], side_m: float, *, height_m: float = 0.0
) -> None:
    """Write a scene of objects whose assets lie in folders of their names beside it.

    Parameters
    ----------
    path
        ``.xml`` is MJCF, ``.sdf`` an SDF world, ``.usda`` USD.
    names, poses
        Folder of each object's asset, from the scene's folder, and its (4, 4) object-to-world pose, metres.
        An object may come several times.
    side_m, height_m
        Side of the square table, and height of its top above the ground.

    Raises
    ------
    InputError
        Another suffix.
    """
    WRITERS[format_of_scene(path)](path, names, poses, side_m, height_m)


def format_of_scene(path: Path) -> str:
    """Return the format of `FORMATS` in which the objects of a scene are written, by its suffix.

    Raises
    ------
    InputError
        A suffix of no format of scenes.
    """
    if path.suffix not in SUFFIXES:
        raise InputError(str(path), "its suffix names no format of scenes", f"Use {', '.join(SUFFIXES)}.")
    return SUFFIXES[path.suffix]


def _mjcf(path: Path, names: Sequence[str], poses: Sequence[Floats], side_m: float, height_m: float) -> None:
    root = Element("mujoco", model=path.stem)
    SubElement(root, "option", timestep="0.002")
    custom = SubElement(root, "custom")
    for name, data in LOOK.items():
        SubElement(custom, "text", name=name, data=data)
    assets = SubElement(root, "asset")
    for name in dict.fromkeys(names):
        SubElement(assets, "model", name=name, file=f"{name}/{FORMATS['mjcf'][0]}")
    world = SubElement(root, "worldbody")
    SubElement(world, "light", pos="0 -1 2", dir="0 0.4 -1", diffuse="0.8 0.8 0.8")
    SubElement(
        world, "geom", name="table", type="box", pos=numbers([0, 0, height_m - TABLE_THICKNESS_M / 2]),
        size=numbers([side_m / 2, side_m / 2, TABLE_THICKNESS_M / 2]), rgba=numbers(TABLE_COLOUR),
        friction=number(LEAST_FRICTION),
    )  # fmt: skip
    for place, (name, pose) in enumerate(zip(names, poses, strict=True)):
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        frame = SubElement(world, "frame", pos=numbers(pose[:3, 3]), quat=numbers([w, x, y, z]))
        SubElement(frame, "attach", model=name, body=name, prefix=f"{place}_")
    write_xml(path, root)


def _sdf(path: Path, names: Sequence[str], poses: Sequence[Floats], side_m: float, height_m: float) -> None:
    root = Element("sdf", version="1.7")
    world = SubElement(root, "world", name=path.stem)
    table = SubElement(world, "model", name="table")
    SubElement(table, "static").text = "true"
    SubElement(table, "pose").text = f"0 0 {number(height_m - TABLE_THICKNESS_M / 2)} 0 0 0"
    link = SubElement(table, "link", name="table")
    for tag in ("visual", "collision"):
        box = SubElement(SubElement(SubElement(link, tag, name=tag), "geometry"), "box")
        SubElement(box, "size").text = numbers([side_m, side_m, TABLE_THICKNESS_M])
    for place, (name, pose) in enumerate(zip(names, poses, strict=True)):
        include = SubElement(world, "include")
        SubElement(include, "name").text = f"{place}_{name}"
        SubElement(include, "uri").text = name
        angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        SubElement(include, "pose").text = numbers([*pose[:3, 3], *angles])
    write_xml(path, root)


def _usd(path: Path, names: Sequence[str], poses: Sequence[Floats], side_m: float, height_m: float) -> None:
    with needs_extra("simulators"):
        from pxr import Gf, Usd, UsdGeom, UsdPhysics
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/scene").GetPrim())
    UsdPhysics.Scene.Define(stage, "/scene/physics")
    table = UsdGeom.Cube.Define(stage, "/scene/table")
    table.CreateSizeAttr(1.0)
    table.AddTranslateOp().Set(Gf.Vec3d(0, 0, height_m - TABLE_THICKNESS_M / 2))
    table.AddScaleOp().Set(Gf.Vec3f(side_m, side_m, TABLE_THICKNESS_M))
    UsdPhysics.CollisionAPI.Apply(table.GetPrim())
    for place, (name, pose) in enumerate(zip(names, poses, strict=True)):
        frame = UsdGeom.Xform.Define(stage, f"/scene/object_{place}")
        frame.GetPrim().GetReferences().AddReference(f"./{name}/{FORMATS['usd'][0]}")
        frame.AddTransformOp().Set(Gf.Matrix4d(*np.asarray(pose).T.ravel().tolist()))
    path.write_text(stage.GetRootLayer().ExportToString(), encoding="utf-8")


WRITERS = {"mjcf": _mjcf, "sdf": _sdf, "usd": _usd}
