"""Task of stage `fidelity`: an encoded object against its ground truth."""

from objectfolder.fidelity.verification import verify_object as verify
from objectfolder.object_file import ObjectFile
from objectfolder.store import Product, read_product
from objectfolder.tensor_file import TensorFile
from pipeline.task import Request


def verify_object(request: Request) -> tuple[TensorFile, Product]:
    """Return the Object File with its fidelity, and the measures with pictures and sounds."""
    measures, verified = verify(
        ObjectFile.load(request.inputs["encoded"]),
        read_product(request.inputs["views"]),
        read_product(request.inputs["modes"]),
        read_product(request.inputs["touches"]),
    )
    return verified.content(), measures
