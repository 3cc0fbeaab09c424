"""Modes against a laboratory's block, a real bowl, and recorded impacts on things that lay or were held."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.reality.row import Aim, Row
from bench.record import REPOSITORY, cpu_seconds
from objectfolder.audio.synthesis.support import LYING_PER_S
from objectfolder.making.damping import damping_of
from objectfolder.making.materials import Material, read_materials
from objectfolder.making.mesh.ingest import ingest_object
from objectfolder.making.modes.modes import simulate_modes
from objectfolder.products.store import Product
from objectfolder.surface.textured_mesh import textured_mesh_of

Floats = NDArray[np.float64]
MATERIALS = REPOSITORY / "data" / "materials.csv"
BLOCK_LENGTH_M = 0.01192
OGI = "H. Ogi et al., J. Acoust. Soc. Am. 112, 2553 (2002)"
DIFFSOUND = (
    "X. Jin et al., DiffSound, SIGGRAPH 2024, repository at d2a97cd; partials of its recordings are ours"
)
TDW = "J. Traer, M. Cusimano, J. H. McDermott, DAFx 2019; tables of TDW 1.13.0 (BSD)"
BAND_HZ = (500.0, 16000.0)
# Tables of modes by our material, and those from which `LYING_PER_S` was chosen.
STRUCK = {
    "ceramic": ("ceramic_0_mm", "Ceramic_3_mm"),
    "glass": ("glass_0_mm",),
    "wood": ("wood_medium_0_mm", "wood_soft_0_mm", "wood_hard_0_mm"),
    "plastic": ("plastic_hard_0_mm", "plastic_hard_3_mm"),
}
# Chosen within what is published, with all tables in view.
ESTIMATED = ("ceramic", "wood", "plastic")
FITTED = ("ceramic_0_mm", "glass_0_mm", "wood_medium_0_mm", "wood_soft_0_mm")


def compare(folder: Path) -> list[Row]:
    """Compare with the measurements of the bundle's ``sound``; see `Row`."""
    return [*_block(folder / "block"), *_bowl(folder / "bowl"), *_struck_things(folder / "struck_things")]


def _block(folder: Path) -> list[Row]:
    start = cpu_seconds()
    stated = {
        name: float(value) for name, value in _table(folder / "material.csv")[0].items() if name != "name"
    }
    block = replace(read_materials(MATERIALS)["steel"], name="aluminium block", **stated)
    resonances = _table(folder / "resonances.csv")
    measured_hz = np.array([1e3 * float(row["measured_khz"]) for row in resonances])
    usable = np.array([row["usable"] == "yes" for row in resonances])
    modes = _modes(folder / "block.obj", block, 1.02 * measured_hz.max(), BLOCK_LENGTH_M)
    # Two of its resonances are misread; the order of the others shows which modes they are.
    modes_hz = modes["frequencies_hz"][: len(measured_hz)]
    return [
        Row(
            sense="sound",
            thing="aluminium block, resonant ultrasound",
            quantity=f"{usable.sum()} resonances, cents",
            figures=_cents(modes_hz[usable], measured_hz[usable]),
            repeatability="",
            fitted="nothing: sides, density and elastic constants are the publication's",
            held_out="all but two that it reads otherwise than it computes them",
            source=OGI,
            cpu_s=cpu_seconds() - start,
            aims=(Aim("median", most=2.65), Aim("rms", most=4.15)),
        )
    ]


def _bowl(folder: Path) -> list[Row]:
    start = cpu_seconds()
    ceramic = read_materials(MATERIALS)["ceramic"]
    rows = _table(folder / "partials.csv")
    recorded_hz, hand_hz = (
        np.array([float(row[name]) for row in rows]) for name in ("recorded_hz", "ours_hz_at_b311972")
    )
    modes = _modes(folder / "bowl.obj", ceramic, 1.02 * hand_hz.max(), None)
    # Which mode is which partial was said by hand, by the mode's frequency.
    which = np.abs(np.subtract.outer(hand_hz, modes["frequencies_hz"])).argmin(axis=1)
    modes_hz, decays_per_s = modes["frequencies_hz"][which], modes["dampings_per_s"][which]
    decays = [(row["decay_per_s_low"], row["decay_per_s_high"]) for row in rows]
    measured = np.array([bool(low and high) for low, high in decays])
    low, high = np.array([tuple(map(float, pair)) for pair in decays if all(pair)]).T
    # At the recorded frequency: a mode that is too low would decay too slowly for that alone.
    decays_per_s = decays_per_s * recorded_hz / modes_hz
    cpu_s = cpu_seconds() - start
    row = Row(
        sense="sound",
        thing="ceramic bowl, struck",
        quantity=f"{len(rows)} partials, cents",
        figures=_cents(modes_hz, recorded_hz),
        repeatability="",
        fitted="nothing: the default ceramic",
        held_out="all",
        source=DIFFSOUND,
        cpu_s=cpu_s,
    )
    ratio = decays_per_s[measured] / np.sqrt(low * high)
    decay = replace(
        row,
        quantity=f"decay of {measured.sum()} partials, factor",
        fitted="nothing; the loss factor, an estimate, was chosen with the bowl in view",
        figures={"median": _median_factor(ratio), "rms": _rms_factor(ratio), "worst": _worst_factor(ratio)},
        repeatability=f"factor {np.median(high / low):.2f}, {np.max(high / low):.2f} at most, over strikes",
        aims=(Aim("median", most=1.4), Aim("worst", most=2.0)),
    )
    return [row, decay]


def _struck_things(folder: Path) -> list[Row]:
    materials, rows = read_materials(MATERIALS), []
    for name, tables in STRUCK.items():
        start = cpu_seconds()
        ratios = {table: _decay_ratios(folder / f"{table}.json", materials[name]) for table in tables}
        apart = [ratios[table] for table in tables if table not in FITTED]
        figures = {"rms": _rms_factor(np.concatenate(list(ratios.values())))}
        if apart:
            figures["rms held out of the support"] = _rms_factor(np.concatenate(apart))
        part = ", ".join(table for table in tables if table in FITTED)
        fitted = ["loss factor, within what is published"] if name in ESTIMATED else []
        fitted += [f"`Support.lying`, to {part}"] if part else []
        rows.append(
            Row(
                sense="sound",
                thing=f"{name}, struck as it lay or was held",
                quantity=f"decay of {sum(map(len, ratios.values()))} modes, factor",
                figures=figures,
                repeatability="",
                fitted="; ".join(fitted),
                held_out=", ".join(table for table in tables if table not in FITTED)
                or "none of these tables",
                source=TDW,
                cpu_s=cpu_seconds() - start,
                aims=(Aim("rms", most=1.9),),
            )
        )
    return rows


def _decay_ratios(path: Path, material: Material) -> Floats:
    """Decay rates (modes,) by default over those of a table, in the band where it has enough of them."""
    content = json.loads(path.read_text(encoding="utf-8"))
    hertz, rt60_s = (np.array(content[key], dtype=np.float64) for key in ("cf", "rt"))
    within = (hertz >= BAND_HZ[0]) & (hertz < BAND_HZ[1])
    own = damping_of(material).decay_rates((2 * np.pi * hertz) ** 2)
    return ((own + LYING_PER_S) / (3 * np.log(10) / rt60_s))[within]


def _modes(mesh: Path, material: Material, limit_hz: float, length_m: float | None) -> Product:
    ingested = ingest_object(mesh, length_m=length_m, object_id=mesh.stem, with_textures=False)
    surface = textured_mesh_of(ingested).surface
    return simulate_modes(surface, material, max_frequency_hz=limit_hz, training_points=8, held_out_points=8)


def _cents(modes_hz: Floats, measured_hz: Floats) -> dict[str, float]:
    cents = 1200 * np.abs(np.log2(modes_hz / measured_hz))
    return {"median": float(np.median(cents)), "rms": _rms(cents), "worst": float(cents.max())}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _rms_factor(ratios: Floats) -> float:
    """Geometric rms: the factor that is 1 where all ratios are."""
    return float(np.exp(_rms(np.log(ratios))))


def _median_factor(ratios: Floats) -> float:
    return float(np.exp(np.median(np.abs(np.log(ratios)))))


def _worst_factor(ratios: Floats) -> float:
    return float(np.exp(np.abs(np.log(ratios)).max()))


def _table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(lines))
