"""Task of stage `views`: what the object looks like, by path tracing."""

from objectfolder.making.views.views import simulate_views
from objectfolder.products.store import Product, read_product
from objectfolder.surface.textured_mesh import textured_mesh_of
from objectfolder.vision.appearance import Appearance
from pipeline.dataset.task import Request


def render_views(request: Request) -> Product:
    """Render the training and held-out views of one object."""
    return simulate_views(
        textured_mesh_of(read_product(request.inputs["objects"])),
        Appearance(**request.record["appearance"]),
        **request.parameters["vision"],
        seed=request.seed,
    )
