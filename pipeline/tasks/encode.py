"""Task of stage `encode`: ground truth to an Object File that is neither named nor measured yet."""

from objectfolder.making.encoding import encode_object as encode
from objectfolder.products.store import read_product
from objectfolder.products.tensor_file import TensorFile
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.touch.sensor.sensor import Sensor
from pipeline.dataset.task import Request


def encode_object(request: Request) -> TensorFile:
    """Fit the encoders of one object to its ground truth."""
    effort = request.parameters["encode"]
    touches = read_product(request.inputs["touches"], ("points",))
    mesh = textured_mesh_of(read_product(request.inputs["objects"]))
    file = encode(
        mesh.surface,
        read_product(request.inputs["views"]),
        read_product(request.inputs["modes"]),
        Sensor.from_dict(touches.attributes["sensor"]),
        # What the object is called and made of is written when it is verified, so that a change of
        # name fits nothing again.
        {"object": {"id": request.object_id}, "material": None, "body": None, "provenance": None},
        contact=touches.attributes["contact"],
        visionnet=effort["visionnet"],
        audionet=effort["audionet"],
        mesh=mesh,
        seed=request.seed,
    )
    return file.content()
