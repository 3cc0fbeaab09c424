"""Task of stage `fidelity`: an encoded object against its ground truth."""

import numpy as np

from objectfolder.fidelity.verification import verify_object as verify
from objectfolder.making.mesh.body import body_of
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import read_attributes, read_product
from objectfolder.simulators.parts_product import parts_of
from objectfolder.vision.appearance import THIN
from pipeline.dataset.task import Request, Timed

DESCRIBED = ("name", "source", "licence", "attribution", "mass_kg")


def verify_object(request: Request) -> Timed:
    """Return the Object File with its name and fidelity, and the measures with pictures and sounds."""
    record = request.record
    encoded = ObjectFile.load(request.inputs["encoded"])
    measured = read_attributes(request.inputs["objects"])
    modes = read_product(request.inputs["modes"])
    density = record["material"]["density_kg_m3"]
    body = body_of(measured, density, modes.attributes)
    if encoded.modes.absent:
        body["warnings"] += modes.attributes["warnings"]
    views = read_product(request.inputs["views"])
    if not encoded.vision.states("albedo"):
        body["warnings"].append(
            f"sight is learned from {np.count_nonzero(~views['held_out'])} views: "
            f"no map of base colours holds {len(encoded.surface.faces)} faces"
        )
    if encoded.vision.glass == THIN:
        body["warnings"].append(
            "glass is drawn with thin walls: light goes straight through each, and nothing is refracted"
        )
    elif "glass" in record["material"]["name"].lower():
        body["warnings"].append("glass is drawn opaque, as a glossy surface: no light passes through it")
    named = encoded.with_description(
        body=body,
        object={"id": request.object_id, **{key: record[key] for key in DESCRIBED}},
        material={
            **record["material"],
            "citation": record["material_citation"],
            "loss_citation": record["loss_citation"],
            "roughness_um": record["roughness_um"],
        },
    )
    parts = read_product(request.inputs["collision"])
    if parts.attributes["absent"] is None:
        named = named.with_collision(parts_of(parts, request.object_id))
    verification = verify(
        named,
        views,
        modes,
        read_product(request.inputs["touches"]),
    )
    products = (verification.file.content(), verification.measures)
    return Timed(products, verification.query_seconds)
