"""Task of stage `fidelity`: an encoded object against its ground truth."""

from objectfolder.fidelity.verification import verify_object as verify
from objectfolder.object_file import ObjectFile
from objectfolder.store import Product, read_product
from objectfolder.tensor_file import TensorFile
from pipeline.task import Request

DESCRIBED = ("name", "source", "licence", "attribution")


def verify_object(request: Request) -> tuple[TensorFile, Product]:
    """Return the Object File with its name and fidelity, and the measures with pictures and sounds."""
    record = request.record
    encoded = ObjectFile.load(request.inputs["encoded"])
    named = encoded.with_description(
        object={"id": request.object_id, **{key: record[key] for key in DESCRIBED}},
        material={**record["material"], "citation": record["material_citation"]},
    )
    measures, verified = verify(
        named,
        read_product(request.inputs["views"]),
        read_product(request.inputs["modes"]),
        read_product(request.inputs["touches"]),
    )
    return verified.content(), measures
