"""The formats of simulators, and the folder of one asset.

MJCF is MuJoCo's, SDF Gazebo's. URDF is read by PyBullet, SAPIEN, Drake, Isaac, ROS and MuJoCo. Each has one
free body whose inertia is explicit, so hulls and looks add no mass.
XML is indented, and keeps every digit of a float.
"""

import json
from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from objectfolder.simulators.asset import Asset
from objectfolder.simulators.mesh_files import collision_name, visual_name, write_meshes
from objectfolder.simulators.usd import write_usd


def number(value: float) -> str:
    """Return the shortest text that reads back as the same float."""
    return repr(float(value))


def numbers(values: Iterable[float]) -> str:
    """Return numbers separated by spaces."""
    return " ".join(map(number, np.ravel(np.asarray(values, dtype=np.float64))))


def write_xml(path: Path, root: ElementTree.Element) -> None:
    """Write an indented document."""
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode", xml_declaration=False)
    path.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")


def write_urdf(path: Path, asset: Asset) -> None:
    """Write an asset, beside its meshes, as URDF.

    PyBullet multiplies the friction of two bodies, PhysX averages them, Drake takes their harmonic mean.
    PyBullet reads the inertia only with its flag URDF_USE_INERTIA_FROM_FILE. MuJoCo's reader strips folders
    from mesh files and drops visuals unless told otherwise, which the element `mujoco` does.
    """
    root = Element("robot", {"name": asset.name, "xmlns:drake": "http://drake.mit.edu"})
    SubElement(
        SubElement(root, "mujoco"), "compiler",
        strippath="false", discardvisual="false", balanceinertia="false", fusestatic="false",
    )  # fmt: skip
    link = SubElement(root, "link", name=asset.name)
    friction = number(asset.contact.friction)
    contact = SubElement(link, "contact")
    SubElement(contact, "lateral_friction", value=friction)
    SubElement(contact, "restitution", value=number(asset.contact.restitution))
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=numbers(asset.body.centre_of_mass_m), rpy="0 0 0")
    SubElement(inertial, "mass", value=number(asset.body.mass_kg))
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = asset.body.inertia_kg_m2
    moments = {"ixx": ixx, "ixy": ixy, "ixz": ixz, "iyy": iyy, "iyz": iyz, "izz": izz}
    SubElement(inertial, "inertia", {name: number(value) for name, value in moments.items()})
    for index in range(len(asset.visual)):
        name = visual_name(index)
        visual = SubElement(link, "visual", name=name)
        SubElement(SubElement(visual, "geometry"), "mesh", filename=f"{name}.obj")
    for index in range(len(asset.collision.hulls)):
        name = collision_name(index)
        collision = SubElement(link, "collision", name=name)
        SubElement(SubElement(collision, "geometry"), "mesh", filename=f"{name}.obj")
        drake = SubElement(collision, "drake:proximity_properties")
        SubElement(drake, "drake:mu_dynamic", value=friction)
        SubElement(drake, "drake:mu_static", value=friction)
    write_xml(path, root)


SDF_VERSION = "1.7"
SDF_CONFIG = "model.config"


def write_sdf(path: Path, asset: Asset) -> None:
    """Write an asset, beside its meshes, as an SDF model, and `model.config`, which Gazebo looks for.

    Mass and inertia are explicit: `<inertial auto="true">` would take them from the hulls, which overlap.
    """
    root = Element("sdf", version=SDF_VERSION)
    model = SubElement(root, "model", name=asset.name)
    link = SubElement(model, "link", name=asset.name)
    inertial = SubElement(link, "inertial")
    _text(inertial, "pose", f"{numbers(asset.body.centre_of_mass_m)} 0 0 0")
    _text(inertial, "mass", number(asset.body.mass_kg))
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = asset.body.inertia_kg_m2
    inertia = SubElement(inertial, "inertia")
    for name, value in {"ixx": ixx, "ixy": ixy, "ixz": ixz, "iyy": iyy, "iyz": iyz, "izz": izz}.items():
        _text(inertia, name, number(value))
    for index in range(len(asset.visual)):
        visual = SubElement(link, "visual", name=visual_name(index))
        _mesh(visual, visual_name(index))
    for index in range(len(asset.collision.hulls)):
        collision = SubElement(link, "collision", name=collision_name(index))
        _mesh(collision, collision_name(index))
        surface = SubElement(collision, "surface")
        friction = SubElement(SubElement(surface, "friction"), "ode")
        for name in ("mu", "mu2"):
            _text(friction, name, number(asset.contact.friction))
        _text(SubElement(surface, "bounce"), "restitution_coefficient", number(asset.contact.restitution))
    write_xml(path, root)
    config = Element("model")
    _text(config, "name", asset.name)
    _text(config, "version", "1.0")
    SubElement(config, "sdf", version=SDF_VERSION).text = path.name
    _text(config, "description", f"{asset.credit.attribution}; {asset.credit.licence}")
    write_xml(path.parent / SDF_CONFIG, config)


def _mesh(parent: Element, name: str) -> None:
    _text(SubElement(SubElement(parent, "geometry"), "mesh"), "uri", f"{name}.obj")


def _text(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text


VISUAL_GROUP, COLLISION_GROUP = "2", "3"
# Half of MuJoCo's time constant of a contact, so that a body at rest sinks in a quarter as far; it wants
# steps of 5 ms or less.
SOLREF = "0.01 1"


def write_mjcf(path: Path, asset: Asset) -> None:
    """Write an asset, beside its meshes, as MJCF that compiles alone and attaches to a scene.

    MuJoCo takes the larger friction of two bodies. It has no coefficient of restitution. The visual mesh's
    own inertia is not asked for (`inertia="shell"`), since MuJoCo refuses open meshes otherwise.
    """
    root = Element("mujoco", model=asset.name)
    SubElement(root, "compiler", angle="radian", meshdir=".")
    assets = SubElement(root, "asset")
    world = SubElement(root, "worldbody")
    body = SubElement(world, "body", name=asset.name)
    SubElement(body, "freejoint", name=asset.name)
    inertia = np.asarray(asset.body.inertia_kg_m2)
    SubElement(
        body,
        "inertial",
        pos=numbers(asset.body.centre_of_mass_m),
        mass=number(asset.body.mass_kg),
        fullinertia=numbers([*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]),
    )
    for index, part in enumerate(asset.visual):
        name = visual_name(index)
        SubElement(assets, "mesh", name=name, file=f"{name}.obj", inertia="shell")
        shine = 1 - asset.appearance.roughness
        looks: dict[str, str] = {"specular": number(0.5 * shine), "shininess": number(shine)}
        if part.texture is not None:
            SubElement(assets, "texture", name=name, type="2d", file=f"{name}.png")
            looks["texture"] = name
        SubElement(assets, "material", {"name": name, **looks})
        SubElement(
            body, "geom", name=name, type="mesh", mesh=name, material=name,
            contype="0", conaffinity="0", group=VISUAL_GROUP, mass="0",
        )  # fmt: skip
    for index in range(len(asset.collision.hulls)):
        name = collision_name(index)
        SubElement(assets, "mesh", name=name, file=f"{name}.obj")
        SubElement(
            body, "geom", name=name, type="mesh", mesh=name, mass="0", group=COLLISION_GROUP,
            friction=number(asset.contact.friction), solref=SOLREF,
        )  # fmt: skip
    write_xml(path, root)


FORMATS: dict[str, tuple[str, Callable[[Path, Asset], None]]] = {
    "mjcf": ("object.xml", write_mjcf),
    "urdf": ("object.urdf", write_urdf),
    "sdf": ("model.sdf", write_sdf),
    "usd": ("object.usda", write_usd),
}
DESCRIPTION = "object.json"


def write_asset(folder: Path, asset: Asset, formats: Collection[str] = tuple(FORMATS)) -> dict[str, Any]:
    """Write an asset into an empty folder; return its description.

    Parameters
    ----------
    formats
        Some of ``mjcf`` (``object.xml``), ``urdf`` (``object.urdf``), ``sdf`` (``model.sdf`` and
        ``model.config``) and ``usd`` (``object.usda``).

    Returns
    -------
    dict
        What ``object.json`` holds: mass, centre, inertia, contact, collision measures, credit, files.

    Raises
    ------
    InputError
        A library that a format needs is missing.
    """
    files = write_meshes(folder, asset)
    for name in formats:
        file, write = FORMATS[name]
        write(folder / file, asset)
        files.append(file)
    described = {
        "object": asset.credit.to_dict(),
        "unit": "metre, kilogram, second; object frame, z up",
        "mass_kg": asset.body.mass_kg,
        "mass_of": asset.mass_of,
        "centre_of_mass_m": np.asarray(asset.body.centre_of_mass_m).tolist(),
        "inertia_kg_m2": np.asarray(asset.body.inertia_kg_m2).tolist(),
        "friction": asset.contact.friction,
        "restitution": asset.contact.restitution,
        "collision": asset.collision.to_dict(),
        "files": files,
    }
    (folder / DESCRIPTION).write_text(json.dumps(described, indent=1) + "\n", encoding="utf-8")
    return described
