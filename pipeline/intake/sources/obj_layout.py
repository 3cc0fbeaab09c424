"""The one image that an OBJ of a source means, whatever its material library writes."""

from pathlib import Path

from objectfolder.errors import FormatError, InputError
from objectfolder.geometry.material_library import read_material_library
from objectfolder.geometry.obj import material_libraries

REMEDY = "The source's files are at fault, or laid out differently than they were: look at them."


def obj_texture(folder: Path, mesh: str) -> str | None:
    """Return the path in `folder` of the base colour image of a mesh in it.

    The name is mended as when the mesh is loaded: blanks after it, and images that lie in
    ``materials/textures`` beside the folder of the library.

    Returns
    -------
    str or None
        None where the materials name several images, or none: the mesh then speaks for itself.

    Raises
    ------
    FormatError
        The mesh, a library or an image is not there, or an image lies outside the folder.
    """
    path = folder / mesh
    if not path.is_file():
        raise FormatError(mesh, "not among the downloaded files", REMEDY)
    try:
        libraries = [read_material_library(path, name) for name in dict.fromkeys(material_libraries(path))]
    except InputError as problem:
        raise FormatError(mesh, f"its material library {problem.finding}", REMEDY) from problem
    images = {material.texture for library in libraries for material in library.values()}
    if len(images) != 1 or None in images:
        return None
    image = next(image for image in images if image is not None).resolve()
    if not image.is_relative_to(folder.resolve()):
        raise FormatError(mesh, "its material library names an image outside the object's folder", REMEDY)
    return image.relative_to(folder.resolve()).as_posix()
