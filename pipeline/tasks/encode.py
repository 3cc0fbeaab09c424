"""Task of stage `encode`: ground truth to an Object File whose fidelity is not measured yet."""

from objectfolder.encoding import encode_object as encode
from objectfolder.geometry.ingest import textured_mesh_of
from objectfolder.store import read_product
from objectfolder.tensor_file import TensorFile
from objectfolder.touch.sensor import Sensor
from pipeline.task import Request


def encode_object(request: Request) -> TensorFile:
    """Fit the encoders of one object; reads its objects, views, modes and touches products."""
    record, effort = request.record, request.parameters["encode"]
    description = {
        "object": {
            "id": request.object_id,
            **{key: record[key] for key in ("name", "source", "licence", "attribution")},
        },
        "material": record["material"],
        "provenance": None,  # written with the product
    }
    touches = read_product(request.inputs["touches"], ("points",))
    file = encode(
        textured_mesh_of(read_product(request.inputs["objects"])).surface,
        read_product(request.inputs["views"]),
        read_product(request.inputs["modes"]),
        Sensor.from_dict(touches.attributes["sensor"]),
        description,
        visionnet=effort["visionnet"],
        audionet=effort["audionet"],
        seed=request.seed,
    )
    return file.content()
