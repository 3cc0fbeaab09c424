"""Task of stage `collision`: convex parts for where simulated bodies touch."""

from objectfolder.errors import UnsolvableError
from objectfolder.products.store import Product, read_product
from objectfolder.simulators.collision import convex_parts
from objectfolder.simulators.parts_product import absent_parts, parts_product
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.dataset.task import Request


def part_object(request: Request) -> Product:
    """Part one object into convex hulls; where it does not allow that, say why it has none."""
    surface = textured_mesh_of(read_product(request.inputs["objects"])).surface
    asked = request.parameters["collision"]
    try:
        return parts_product(convex_parts(surface, **asked, seed=request.seed, name=request.object_id))
    except UnsolvableError as problem:
        return absent_parts(f"{problem.finding}. {problem.remedy}")
