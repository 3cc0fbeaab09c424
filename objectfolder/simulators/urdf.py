"""URDF: one link with explicit inertia; read by PyBullet, SAPIEN, Drake, Isaac, ROS and MuJoCo."""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from objectfolder.simulators.asset import Asset
from objectfolder.simulators.mesh_files import collision_name, visual_name
from objectfolder.simulators.xml_text import number, numbers, write_xml

DRAKE = "{http://drake.mit.edu}"


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
