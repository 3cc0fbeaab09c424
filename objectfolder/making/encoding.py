"""From simulated ground truth to an Object File: the surface once, then one encoder a sense."""

from collections.abc import Mapping
from typing import Any

from objectfolder.making.audionet.fitting import fit_audionet
from objectfolder.making.visionnet.fitting import fit_visionnet
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import Product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.textured_mesh import TexturedMesh
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.touchnet import TouchNet
from objectfolder.vision.appearance import Appearance


def encode_object(
    surface: Surface,
    views: Product,
    modes: Product,
    sensor: Sensor,
    description: Mapping[str, Any],
    *,
    contact: str = "rigid",
    visionnet: Mapping[str, Any],
    audionet: Mapping[str, Any],
    mesh: TexturedMesh | None = None,
    seed: int,
) -> ObjectFile:
    """Fit all encoders on the training part of the truth.

    Parameters
    ----------
    surface
        The cleaned surface, metres; the encoders see only its compressed form.
    views, modes
        Ground truth of sight and sound. Touch needs none: its encoder is the surface and the sensor.
    sensor
        The tactile sensor of the data set.
    description
        Keys ``object``, ``material``, ``body`` and ``provenance``.
    contact
        The contact model of the data set's touches.
    visionnet, audionet
        Keyword arguments of `fit_visionnet` and `fit_audionet`.
    mesh
        The textured mesh of that surface, whose maps of normals, alpha, roughness and metallic are stored.
    seed
        Seed of the fits.

    Returns
    -------
    ObjectFile
        Its fidelity not measured yet.

    Examples
    --------
    >>> import objectfolder
    >>> from objectfolder.products import read_product
    >>> from objectfolder.touch import Sensor
    >>> views, modes = read_product("views.zarr.zip"), read_product("modes.zarr.zip")
    >>> bar = objectfolder.load("bar.safetensors")
    >>> fit = {"visionnet": {"steps": 2}, "audionet": {}, "seed": 0}
    >>> file = encode_object(bar.surface, views, modes, Sensor(), bar.description, **fit)
    >>> len(file.modes.frequencies_hz) == len(modes["frequencies_hz"])
    True
    """
    tensors = encode_surface(surface)
    stored = decode_surface(tensors)
    frame = UnitFrame.from_dict(views.attributes["frame"])
    maps = None
    if mesh is not None:
        appearance = Appearance(**views.attributes["appearance"])
        material = visionnet.get("material", "learned")
        maps = sample_maps(stored_mesh(mesh, stored), frame, appearance, material)
    return ObjectFile.of_encoders(
        tensors,
        frame,
        fit_visionnet(stored, frame, views, maps=maps, seed=seed, **visionnet),
        fit_audionet(stored, modes, **audionet),
        TouchNet(stored, sensor, contact=contact),
        {**description, "fidelity": None},
    )
