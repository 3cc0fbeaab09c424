"""Task of stage `modes`: how the object vibrates."""

from objectfolder.errors import UnsolvableError
from objectfolder.making.materials import Material
from objectfolder.making.modes.absent import LEFT_OUT, absent_modes
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.products.store import Product, read_product
from objectfolder.surface.textured_mesh import textured_mesh_of
from pipeline.dataset.task import Request

AUDIO = "audio"


def compute_modes(request: Request) -> Product:
    """Solve the modes of one object; where it does not allow that, say why it has no sound."""
    if AUDIO not in request.record["senses"]:
        return absent_modes(LEFT_OUT)
    surface = textured_mesh_of(read_product(request.inputs["objects"])).surface
    # Appearance and citation mean nothing to sound, and are no part of what this task reads.
    material = Material(**request.record["material"], roughness=0.5, metallic=0.0, citation="")
    audio = request.parameters["audio"]
    asked = {**audio, **request.record["walls"], "seed": request.seed, "name": request.object_id}
    try:
        return simulate_modes(surface, material, **asked)
    except UnsolvableError as problem:
        return absent_modes(f"{problem.finding}. {problem.remedy}")
