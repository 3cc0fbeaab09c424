"""SDF, Gazebo's model format: one link with explicit inertia."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from objectfolder.simulators.asset import Asset
from objectfolder.simulators.mesh_files import collision_name, visual_name
from objectfolder.simulators.xml_text import number, numbers, write_xml

VERSION = "1.7"
CONFIG = "model.config"


def write_sdf(path: Path, asset: Asset) -> None:
    """Write an asset, beside its meshes, as an SDF model, and `model.config`, which Gazebo looks for.

    Mass and inertia are explicit: `<inertial auto="true">` would take them from the hulls, which overlap.
    """
    root = Element("sdf", version=VERSION)
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
    SubElement(config, "sdf", version=VERSION).text = path.name
    _text(config, "description", f"{asset.credit.attribution}; {asset.credit.licence}")
    write_xml(path.parent / CONFIG, config)


def _mesh(parent: Element, name: str) -> None:
    _text(SubElement(SubElement(parent, "geometry"), "mesh"), "uri", f"{name}.obj")


def _text(parent: Element, tag: str, text: str) -> None:
    SubElement(parent, tag).text = text
