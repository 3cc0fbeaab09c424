"""The load of a task: the number by which the cost of computing modes grows.

It is the number of bending modes below the highest frequency, N = √3 S f / (h c), with S half the area, h
the thickness of thin walls and c the longitudinal wave speed of a plate (Cremer and Heckl, Structure-Borne
Sound): the finer an object bends, the more unknowns its solution has. Over a hundred scans its rank
correlation is 0.86 with CPU seconds and 0.85 with memory; nothing known of the other stages foretells their
memory.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from objectfolder.store import read_attributes
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import MODES, OBJECTS

DEFAULT_FREQUENCY_HZ = 20_000.0


class Loads:
    """Loads of the tasks of one data set.

    Parameters
    ----------
    root
        Root of the data set.
    parameters
        Of the run; the default size without them.
    """

    def __init__(self, root: Path, parameters: Parameters | None = None) -> None:
        self._root = root
        self._frequency_hz = parameters.audio.max_frequency_hz if parameters else DEFAULT_FREQUENCY_HZ
        self._materials: dict[str, Mapping[str, float]] | None = None

    def of(self, stage: str, object_id: str) -> float | None:
        """Return the load of a task; None for other stages than modes, and for an object not measured yet."""
        if stage != MODES.made_by:
            return None
        try:
            measured = read_attributes(OBJECTS.path(self._root, object_id))
            return bending_modes(measured, self._material(object_id), self._frequency_hz)
        except (OSError, FormatError, KeyError, TypeError, ValueError, ArithmeticError):
            return None  # no product, or one with impossible attributes; the run reports it

    def _material(self, object_id: str) -> Mapping[str, float]:
        if self._materials is None:
            try:
                rows = read_records(self._root).rows
            except InputError:
                rows = {}
            self._materials = {name: row["material"] for name, row in rows.items()}
        return self._materials[object_id]


def bending_modes(
    measured: Mapping[str, Any], material: Mapping[str, float], frequency_hz: float
) -> float | None:
    """Return about how many bending modes an object has below a frequency, as if it were a plate.

    Parameters
    ----------
    measured
        Attributes of the object's product.
    material
        ``youngs_modulus_pa``, ``density_kg_m3``, ``poisson_ratio``.
    frequency_hz
        Highest frequency.
    """
    walls = measured["wall_thickness"]
    thickness = walls["thin_m"] or walls["median_m"] or walls["effective_m"]
    if not thickness:
        return None
    stiffness = material["youngs_modulus_pa"] / (1 - material["poisson_ratio"] ** 2)
    wave_speed = math.sqrt(stiffness / material["density_kg_m3"])
    return math.sqrt(3) * measured["area_m2"] / 2 * frequency_hz / (thickness * wave_speed)
