"""Convex parts as a product, or the reason why an object has none."""

import numpy as np

from objectfolder.errors import UnsolvableError
from objectfolder.products.store import Array, Product
from objectfolder.surface.convex_parts import ConvexParts
from objectfolder.surface.surface import Surface


def parts_product(parts: ConvexParts) -> Product:
    """Return convex parts as arrays, with their measures as attributes.

    The hulls stand one after another: `corners` of them in `vertices`, `sides` of them in `faces`, whose
    numbers are those of the hull's own vertices.
    """
    return Product(
        {
            "vertices": _array(np.concatenate([hull.vertices for hull in parts.hulls]), "m", "of all hulls"),
            "faces": _array(
                np.concatenate([hull.faces for hull in parts.hulls]), "1", "of all hulls, outward"
            ),
            "corners": _array(
                np.array([len(hull.vertices) for hull in parts.hulls]), "1", "vertices of each hull"
            ),
            "sides": _array(np.array([len(hull.faces) for hull in parts.hulls]), "1", "faces of each hull"),
        },
        {**parts.to_dict(), "absent": None},
    )


def absent_parts(reason: str) -> Product:
    """Return the product of an object that cannot be parted: no hull, and the reason as attribute ``absent``.

    The object keeps its senses; what reads the parts says the reason.
    """
    arrays = {
        "vertices": _array(np.zeros((0, 3)), "m", "of no hull"),
        "faces": _array(np.zeros((0, 3), dtype=np.int64), "1", "of no hull"),
        "corners": _array(np.zeros(0, dtype=np.int64), "1", "vertices of each hull"),
        "sides": _array(np.zeros(0, dtype=np.int64), "1", "faces of each hull"),
    }
    unknown = dict.fromkeys(("union_iou", "outward_m", "inward_m"))
    return Product(arrays, {"parts": 0, "vertices": 0, **unknown, "absent": reason})


def parts_of(product: Product, name: str) -> ConvexParts:
    """Return the convex parts of a product.

    Parameters
    ----------
    name
        What errors call the object.

    Raises
    ------
    UnsolvableError
        It has none; the reason is the product's.
    """
    attributes = product.attributes
    if attributes["absent"] is not None:
        remedy = "Give --most-parts 1 for its convex hull."
        raise UnsolvableError(name, f"it has no collision parts: {attributes['absent']}", remedy)
    vertices = np.split(product["vertices"], np.cumsum(product["corners"])[:-1])
    faces = np.split(product["faces"], np.cumsum(product["sides"])[:-1])
    hulls = tuple(Surface(*hull) for hull in zip(vertices, faces, strict=True))
    return ConvexParts(hulls, attributes["union_iou"], attributes["outward_m"], attributes["inward_m"])


def _array(values: np.ndarray, unit: str, description: str) -> Array:
    dimensions = ("row", "axis")[: values.ndim]
    return Array(values, dimensions, unit, description, chunk_first=False)
