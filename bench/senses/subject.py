"""An object whose sight is measured: its views, its file's sight, and what both cost, kept in a folder."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bench.record import cpu_seconds
from bench.senses.catalogue import Scans
from objectfolder.fidelity.sight import (
    FOREGROUND_ALPHA,
    LEAST_LIT_PIXELS,
    LIT_RADIANCE,
    measure_sight,
    measure_within,
)
from objectfolder.making.views.views import simulate_views
from objectfolder.making.visionnet.fitting import fit_visionnet
from objectfolder.making.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.products.store import Product, read_product, write_product
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.compositing import on_white
from objectfolder.vision.visionnet.visionnet import VisionNet


@dataclass(frozen=True)
class ViewCounts:
    """Pixels a side, and views and paths a pixel of training and of held-out views."""

    resolution: int
    training_views: int
    training_samples: int
    held_out_views: int
    held_out_samples: int

    @property
    def name(self) -> str:
        training = f"{self.training_views}x{self.training_samples}"
        return f"{self.resolution}_{training}_{self.held_out_views}x{self.held_out_samples}"


class Subject:
    """One object.

    Parameters
    ----------
    scans, name
        Where it is from.
    folder
        Where views and networks are kept; they are not made again.
    counts
        Its views.
    material
        As of `fit_visionnet`; of known material nothing is fitted.
    """

    def __init__(self, scans: Scans, name: str, folder: Path, counts: ViewCounts, material: str) -> None:
        self.mesh = scans.mesh(name)
        look = scans.material(name)
        self.appearance = Appearance(roughness=look.roughness, metallic=look.metallic)
        tensors = encode_surface(self.mesh.surface)
        self.surface = decode_surface(tensors)
        self.surface_bytes = sum(tensor.nbytes for tensor in tensors.values())
        self.frame = UnitFrame.of_points(self.mesh.vertices[np.unique(self.mesh.faces)])
        self._counts, self._material = counts, material
        self._views_path = folder / f"{name}_{counts.name}.views.zarr.zip"
        self._net_path = folder / f"{name}_{counts.name}_{material}.net.safetensors"

    @cached_property
    def views(self) -> Product:
        """Training and held-out views."""
        path = self._views_path
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            start = cpu_seconds()
            views = simulate_views(self.mesh, self.appearance, **vars(self._counts), seed=0)
            path.with_suffix(".json").write_text(json.dumps(cpu_seconds() - start), encoding="utf-8")
            write_product(path, views)
        return read_product(path)

    @property
    def views_cpu_s(self) -> float:
        """CPU seconds that the views took, held-out ones included."""
        return float(self._views_path.with_suffix(".json").read_text(encoding="utf-8"))

    @cached_property
    def sight(self) -> tuple[VisionNet, dict[str, float]]:
        """What the object's file shows it by; CPU seconds of making it, and bytes with the surface's."""
        path, views = self._net_path, self.views
        if not path.exists():
            start = cpu_seconds()
            maps = sample_maps(
                stored_mesh(self.mesh, self.surface), self.frame, self.appearance, self._material
            )
            net = fit_visionnet(self.surface, self.frame, views, maps=maps, material=self._material, seed=0)
            size = self.surface_bytes + sum(tensor.nbytes for tensor in net.tensors().values())
            costs = {"fit_cpu_s": cpu_seconds() - start, "bytes": size}
            metadata = {"net": json.dumps(net.metadata()), "costs": json.dumps(costs)}
            write_tensor_file(path, TensorFile(net.tensors(), metadata))
        content = read_tensor_file(path)
        metadata = json.loads(content.metadata["net"])
        net = VisionNet.from_tensors(content.tensors, metadata, self.surface, self.frame)
        return net, json.loads(content.metadata["costs"])

    def held_out(self, name: str) -> np.ndarray:
        """Return an array of the held-out views."""
        array: np.ndarray = self.views[name][self.views["held_out"]]
        return array


def errors(rgba: np.ndarray, answer: np.ndarray) -> dict[str, float]:
    """Return errors of images (n, h, w, 3) uint8 against truth (n, h, w, 4): means, and the worst views.

    Lit pixels are as `fidelity.sight.lit_pixels` has them; nothing of them where no view has enough.
    """
    rgba = rgba.astype(np.float32)
    truth, alpha = on_white(rgba), rgba[..., 3]
    foreground = alpha >= FOREGROUND_ALPHA
    lit = foreground & (rgba[..., :3].max(axis=-1) > LIT_RADIANCE * alpha)
    measured = measure_sight(truth, foreground, answer)
    worst = min(row["psnr_db"] for row in measured.pop("per_view"))
    of_lit = measure_within(truth, lit, answer, LEAST_LIT_PIXELS)
    measured["psnr_foreground_worst_db"] = min(measure_within(truth, foreground, answer))
    return {**measured, "worst_view_db": worst, **({"psnr_lit_db": float(np.mean(of_lit))} if of_lit else {})}
