"""MuJoCo's MJCF: one free body.

The inertial is explicit, so hulls and looks add no mass. The visual mesh's own inertia is not asked for
(`inertia="shell"`), since MuJoCo refuses open meshes otherwise.
"""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from objectfolder.simulators.asset import Asset
from objectfolder.simulators.mesh_files import collision_name, visual_name
from objectfolder.simulators.xml_text import number, numbers, write_xml

VISUAL_GROUP, COLLISION_GROUP = "2", "3"
# Half of MuJoCo's time constant of a contact, so that a body at rest sinks in a quarter as far; it wants
# steps of 5 ms or less.
SOLREF = "0.01 1"


def write_mjcf(path: Path, asset: Asset) -> None:
    """Write an asset, beside its meshes, as MJCF that compiles alone and attaches to a scene.

    MuJoCo takes the larger friction of two bodies. It has no coefficient of restitution.
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
