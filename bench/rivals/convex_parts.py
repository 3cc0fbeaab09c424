"""Ways to stand convex hulls for a solid where bodies touch: how well they fit, and what they take.

    python -m bench.rivals.convex_parts --folder FOLDER [--objects CATALOGUE.csv]

Ours (CoACD with limits of its own), CoACD with more parts, one convex hull, and V-HACD with 16 and with 32
hulls, as MuJoCo's published set of Google's scans has. V-HACD is left out where `vhacdx` is not installed.
"""

from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
import trimesh

from bench.record import conclude, cpu_seconds, kept
from bench.senses.catalogue import VARIED, Scans, scan_arguments
from objectfolder.simulators.collision import convex_parts, measure_parts
from objectfolder.surface.convex_parts import ConvexParts
from objectfolder.surface.surface import Surface

COMPARED = (
    "convex hulls of the same surfaces: volume in both hulls and solid over volume in either, how far hulls "
    "reach out of the solid as a share of the length, hulls, CPU seconds with measuring; medians over scans"
)


def vhacd(surface: Surface, hulls: int) -> ConvexParts:
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, process=False)
    parts = trimesh.decomposition.convex_decomposition(mesh, maxConvexHulls=hulls)
    own = (trimesh.convex.convex_hull(np.asarray(part["vertices"])) for part in parts)
    return measure_parts(
        surface, tuple(Surface(np.array(hull.vertices), np.array(hull.faces)) for hull in own)
    )


WAYS: dict[str, Callable[[Surface], ConvexParts]] = {
    "CoACD, 16 parts (ours)": convex_parts,
    "CoACD, 32 parts": lambda surface: convex_parts(surface, most_parts=32),
    "one hull": lambda surface: convex_parts(surface, most_parts=1),
    "V-HACD, 16 parts": lambda surface: vhacd(surface, 16),
    "V-HACD, 32 parts": lambda surface: vhacd(surface, 32),
}


def measure(surface: Surface, way: Callable[[Surface], ConvexParts]) -> dict[str, Any]:
    start = cpu_seconds()
    parts = way(surface)
    spent = cpu_seconds() - start
    length = float(np.ptp(surface.bounds, axis=0).max())
    return parts.to_dict() | {"outward_share": parts.outward_m / length, "cpu_s": spent}


def main() -> None:
    given = scan_arguments(__doc__ or "", "rows").parse_args()
    scans = Scans(given.objects)
    ways: dict[str, Any] = {}
    for name, way in WAYS.items():
        if "V-HACD" in name and find_spec("vhacdx") is None:
            print(f"left out: {name} (pip install vhacdx)")
            continue
        rows = {}
        for scan in VARIED:
            path = given.folder / f"{scan} {name}.json"
            rows[scan] = kept(path, lambda at=scan, by=way: measure(scans.surface(at), by))
        keys = ("parts", "union_iou", "outward_share", "cpu_s")
        ways[name] = {key: float(np.median([row[key] for row in rows.values()])) for key in keys}
        print(name, ways[name], flush=True)
        ways[name]["objects"] = rows
    packages = {name: version(name) for name in ("coacd", "vhacdx") if find_spec(name)}
    conclude("convex_parts", {"ways": ways}, {"packages": packages, "scans": VARIED}, COMPARED)


if __name__ == "__main__":
    main()
