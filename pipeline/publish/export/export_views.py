"""Views of an object as NeRF or COLMAP data."""

from pathlib import Path
from typing import Any

from objectfolder.errors import InputError
from objectfolder.store import read_product
from objectfolder.vision.export.colmap_views import write_colmap
from objectfolder.vision.export.folder import new_folder
from objectfolder.vision.export.posed_views import PosedViews
from objectfolder.vision.export.transforms import write_transforms
from pipeline.publish.export.export_request import Exporting
from pipeline.publish.export.found_products import FoundProducts


def export_views(found: FoundProducts, wanted: Exporting, output: Path) -> str:
    """Write the views of an object; return what was written, in a line.

    Raises
    ------
    InputError
        No views, or a folder that cannot be written.
    """
    if found.views is None:
        finding = f"has no views, and {wanted.format} is made of them"
        remedy = "Name a product of views, or run the stage `views`; glTF needs none."
        raise InputError(found.object_id, finding, remedy)
    views = PosedViews.of_product(read_product(found.views), wanted.frame, str(found.views))
    credit = found.credit()
    held_out = int(views.held_out.sum())
    said: dict[str, Any] = {"views": len(views), "held_out": held_out, "pixels": list(views.size)}
    with new_folder(output, overwrite=wanted.overwrite) as folder:
        if wanted.format == "nerf":
            said["cameras"] = write_transforms(folder, views, credit, exr=wanted.exr)
        else:
            said["points"] = write_colmap(
                folder,
                views,
                credit,
                found.rendered_surface(),
                points=wanted.points,
                seed=wanted.seed,
                exr=wanted.exr,
            )
        found.write_manifest(folder, wanted.format, {**said, "frame": views.described_frame()})
    extra = f", {said['points']} points" if "points" in said else ""
    return (
        f"{output}: {len(views)} views of {views.size[1]} x {views.size[0]} pixels "
        f"({held_out} held out){extra}, {views.frame} frame; {credit.licence}"
    )
