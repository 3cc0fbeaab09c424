"""Fidelity products and cost tables made by code, for tests of the report."""

import csv
import math
from pathlib import Path

import numpy as np

from objectfolder.fidelity.images import psnr_db
from objectfolder.fidelity.sheets import sheet
from objectfolder.products.store import Array, Product
from pipeline.dataset.failures import FailedObject

HELD_OUT = {"vision": 8, "touch": 6}
HELD_OUT_STRIKES = 4
COST_COLUMNS = [
    "object",
    "stage",
    "fingerprint",
    "cpu_seconds",
    "wall_seconds",
    "peak_memory_mb",
    "key",
    "seconds_per_query",
]


def views(count: int, height: int, width: int, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Shaded balls on white, and the same with noise."""
    generator = np.random.default_rng(seed)
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    truth = np.full((count, height, width, 3), 255, np.uint8)
    for image, light in zip(truth, generator.normal(size=(count, 3)), strict=True):
        z = np.sqrt(np.maximum(0.5 - x * x - y * y, 0))
        shade = 40 + 180 * np.clip(np.stack([x, -y, z], -1) @ (light / np.linalg.norm(light)), 0, 1)
        image[z > 0] = (shade[..., None] * [1.0, 0.8, 0.6])[z > 0]
    answer = np.clip(truth + noise * generator.normal(size=truth.shape) * (truth != 255), 0, 255)
    return truth, answer.astype(np.uint8)


def pictures(
    sense: str, pairs: tuple[np.ndarray, np.ndarray], scores: list[float], count: int
) -> dict[str, Array]:
    """A sheet of all pairs, and some of them as they are, from the worst to the best."""
    chosen = np.argsort(scores)[np.linspace(0, len(scores) - 1, count).round().astype(int)]
    truth, answer = (
        Array(pair[chosen], ("query", "y", "x", "channel"), "1", "a few of them") for pair in pairs
    )
    every = Array(sheet(*pairs), ("byte",), "1", "all", chunk_first=False)
    return {f"{sense}_truth": truth, f"{sense}_answer": answer, f"{sense}_sheet": every}


def fidelity(
    object_id: str,
    *,
    name: str | None = None,
    audible: bool = True,
    shift: float = 0.0,
    size: int = 32,
    stored_pairs: int = 4,
) -> Product:
    """A fidelity product; `shift` makes every measure worse by as many dB."""
    view_pairs = views(HELD_OUT["vision"], size, size, 2 + shift, 1)
    touch_pairs = views(HELD_OUT["touch"], size * 5 // 4, size * 15 // 16, 1 + shift, 2)
    view_scores, touch_scores = (
        [psnr_db(*pair) for pair in zip(*pairs, strict=True)] for pairs in (view_pairs, touch_pairs)
    )
    partials = [(561.6 * 1.7**index, 2.0 + 6.0 * index**1.5) for index in range(7)]
    frequencies, dampings = (np.array([column] * 2) for column in zip(*partials, strict=True))
    eigenvalues = (2 * np.pi * frequencies) ** 2
    shares = 0.02 * np.arange(1, HELD_OUT_STRIKES + 1)
    steps = np.stack([np.full(HELD_OUT_STRIKES, 1 / 32767), shares / 127]).astype(np.float32)
    loud = np.full((HELD_OUT_STRIKES, 7), 127)
    strikes = {
        "strike_eigenvalues": Array(eigenvalues, ("which", "mode"), "rad^2/s^2", "of both"),
        "strike_dampings_per_s": Array(dampings, ("which", "mode"), "1/s", "of both"),
        "strike_truth": Array(np.full_like(loud, 32767, np.int16), ("strike", "mode"), "1", "truth"),
        "strike_difference": Array(-loud.astype(np.int8), ("strike", "mode"), "1", "difference"),
        "strike_steps": Array(steps, ("which", "strike"), "m/s", "of both"),
        "strike_difference_db": Array(
            20 * np.log10(shares).astype(np.float32), ("strike",), "dB", "difference"
        ),
    }
    attributes = {
        "object": {
            "id": object_id,
            "name": name or object_id,
            "material": "ceramic",
            "licence": "CC BY 4.0",
            "attribution": "A. Maker",
            "source": "https://example.org/scan",
            "length_m": 0.16,
        },
        "vision": {
            "psnr_db": 43.0 - shift,
            "psnr_foreground_db": 35.0 - shift,
            "ssim": 0.993 - shift / 1000,
            "noise_floor_db": 57.0,
            "trivial_psnr_db": 21.0,
            "trivial_psnr_foreground_db": 13.0,
            "trivial_ssim": 0.8,
            "held_out_views": 8,
            "training_views": 60,
            "resolution": size,
            "sub_rays": 16,
            "per_view": [
                {"view": index, "psnr_db": score, "psnr_foreground_db": None, "ssim": 0.9}
                for index, score in enumerate(view_scores)
            ],
        },
        "audio": {
            "audible": audible,
            "modes": 73 if audible else 0,
            "first_frequency_hz": 561.6 if audible else None,
            "frequency_limit_hz": 20000,
            "frequency_error_cents": 0.001 + shift if audible else None,
            "damping_error_relative": 1e-7 if audible else None,
            "gain_error_db": -30.0 + shift if audible else None,
            "gain_error_by_mode_median_db": -31.0 + shift if audible else None,
            "gain_error_by_point_p95_db": -26.0 + shift if audible else None,
            "gain_error_by_point_worst_db": -22.0 + shift if audible else None,
            "stft_distance": 1e-6 if audible else None,
            "envelope_distance": 1e-3 if audible else None,
            "solver_error_estimate_cents": 12.0 if audible else None,
            "solver_geometry_error_cents": 3.0 if audible else None,
            "count_certificate": {},
            "held_out_points": 64,
            "damping": {"law": "loss_factor", "loss_factor": 0.002, "loss_exponent": 0.0},
            "modes_table": [
                {"frequency_hz": f, "damping_per_s": c, "t60_s": 3 * math.log(10) / c}
                for f, c in partials * 4
            ]
            if audible
            else [],
        },
        "touch": {
            "psnr_db": 52.0 - shift,
            "psnr_contact_db": 47.0 - shift,
            "ssim": 0.999,
            "empty_psnr_db": 29.6,
            "empty_psnr_contact_db": 20.0,
            "empty_ssim": 0.94,
            "held_out_touches": 24,
            "per_touch": [{"psnr_db": score, "psnr_contact_db": score} for score in touch_scores],
            "unreachable_share": 0.13,
            "surface_bytes": 60_000,
        },
        "bytes": {
            "total": 1_500_000 + round(1000 * shift),
            "surface": 60_000,
            "vision": 900_000,
            "audio": 500_000,
            "touch": 0,
            "metadata": 40_000,
        },
        "speed_error": [
            {
                "sense": sense,
                "setting": unit,
                "value": value,
                "error": error + shift,
                "error_unit": "PSNR, dB" if sense != "audio" else "gain error, dB",
                "bytes": size_bytes,
                "key": f"{sense}.{unit}={value:g}",
            }
            for sense, unit, value, error, size_bytes in (
                ("vision", "sub_rays", 1, 29.0, 900_000),
                ("vision", "sub_rays", 4, 36.5, 900_000),
                ("vision", "sub_rays", 16, 40.9, 900_000),
                ("vision", "sub_rays", 64, 43.5, 900_000),
                ("audio", "modes", 10, -12.0, 70_000),
                ("audio", "modes", 30, -21.0, 210_000),
                ("audio", "modes", 73, -30.0, 500_000),
                ("touch", "samples", 1, 44.0, 60_000),
                ("touch", "samples", 4, 49.0, 60_000),
                ("touch", "samples", 16, 52.0, 60_000),
            )
            if audible or sense != "audio"
        ],
        "definitions": {"vision.psnr_db": "Own words of the product."},
        "provenance": {"fingerprints": {"views": "new", "fidelity": "new"}},
    }
    return Product(
        {
            **pictures("vision", view_pairs, view_scores, stored_pairs),
            **pictures("touch", touch_pairs, touch_scores, stored_pairs),
            **(strikes if audible else {}),
        },
        attributes,
    )


FAILURE = FailedObject("broken", "objects", "model.obj: no faces <b>", "Repair it.")


def write_costs(path: Path, objects: list[str]) -> Path:
    rows: list[dict[str, object]] = []
    for object_id in objects:
        for stage, seconds in zip(
            ["objects", "views", "modes", "touches", "encode", "fidelity"], (2, 40, 60, 5, 50, 9), strict=True
        ):
            cost = {"object": object_id, "stage": stage, "cpu_seconds": seconds, "wall_seconds": seconds}
            rows.append(cost | {"fingerprint": "new", "peak_memory_mb": 400})
        rows.append({"object": object_id, "stage": "views", "fingerprint": "old", "cpu_seconds": 999})
        for rays, seconds in ((1, 0.01), (4, 0.04), (16, 0.15), (64, 0.6)):
            query = {"object": object_id, "stage": "query", "key": f"vision.sub_rays={rays}"}
            rows.append(query | {"fingerprint": "new", "seconds_per_query": seconds})
            rows.append(query | {"fingerprint": "old", "seconds_per_query": 99})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COST_COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows)
    return path
