"""The stages that converge, in order, with the products and the exact inputs of each."""

from pipeline.dataset.job import BLENDER
from pipeline.dataset.product_kinds import (
    COLLISION,
    ENCODED,
    FIDELITY,
    MODES,
    OBJECT_FILES,
    OBJECTS,
    TOUCHES,
    VIEWS,
)
from pipeline.dataset.records import sources
from pipeline.dataset.stage import ProductInput, Stage
from pipeline.dataset.tolerances import TOLERANCES

GEOMETRY = ProductInput(OBJECTS, ("digests.geometry",))
LIT_SURFACE = ProductInput(OBJECTS, ("digests.geometry", "digests.normals"))
SHOWN_SURFACE = ProductInput(OBJECTS, ("digests.geometry", "digests.texture", "digests.normals"))

STAGES = {
    stage.name: stage
    for stage in (
        Stage(
            "objects",
            "pipeline.tasks.objects:prepare_object",
            (OBJECTS,),
            sources=sources,
            fields=("length_m", "file_names", "up"),
            packages=("DracoPy", "embreex", "numpy", "Pillow", "scipy", "zarr"),
            tolerances=TOLERANCES["objects"],
        ),
        Stage(
            "views",
            "pipeline.tasks.views:render_views",
            (VIEWS,),
            inputs=(SHOWN_SURFACE,),
            parameters=("vision",),
            fields=("appearance",),
            packages=("bpy", "embreex", "numpy", "zarr"),
            needs=frozenset({BLENDER}),
            tolerances=TOLERANCES["views"],
        ),
        Stage(
            "modes",
            "pipeline.tasks.modes:compute_modes",
            (MODES,),
            inputs=(GEOMETRY,),
            parameters=("audio",),
            fields=("material", "walls", "senses"),
            packages=(
                "embreex",
                "manifold3d",
                "mkl",
                "numba",
                "numpy",
                "pytetwild",
                "scikit-image",
                "scipy",
                "vtk",
                "zarr",
            ),
            tolerances=TOLERANCES["modes"],
        ),
        Stage(
            "touches",
            "pipeline.tasks.touches:press_sensor",
            (TOUCHES,),
            inputs=(LIT_SURFACE,),
            parameters=("touch",),
            packages=("numba", "numpy", "scipy", "zarr"),
            optional_packages=lambda values: ("pyrender",) if "renderer" in values["touch"] else (),
            tolerances=TOLERANCES["touches"],
        ),
        Stage(
            "collision",
            "pipeline.tasks.collision:part_object",
            (COLLISION,),
            inputs=(GEOMETRY,),
            parameters=("collision",),
            packages=("coacd", "numpy", "pyvista", "scipy", "vtk", "zarr"),
            tolerances=TOLERANCES["collision"],
        ),
        Stage(
            "encode",
            "pipeline.tasks.encode:encode_object",
            (ENCODED,),
            inputs=(
                SHOWN_SURFACE,
                ProductInput(VIEWS),
                ProductInput(MODES),
                ProductInput(TOUCHES, ("sensor", "contact")),
            ),
            parameters=("encode",),
            packages=("embreex", "numba", "numpy", "scipy", "torch"),
            tolerances=TOLERANCES["encode"],
        ),
        Stage(
            "fidelity",
            "pipeline.tasks.verify:verify_object",
            (OBJECT_FILES, FIDELITY),
            inputs=(
                ProductInput(OBJECTS, ("digests.body",)),
                ProductInput(ENCODED),
                ProductInput(VIEWS),
                ProductInput(MODES),
                ProductInput(TOUCHES),
                ProductInput(COLLISION),
            ),
            fields=(
                *("name", "material", "material_citation", "loss_citation", "roughness_um"),
                *("source", "licence", "attribution", "mass_kg"),
            ),
            packages=("embreex", "numba", "numpy", "scikit-image", "scipy", "torch", "zarr"),
            tolerances=TOLERANCES["fidelity"],
        ),
    )
}
