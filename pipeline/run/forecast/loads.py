"""What the cost of a task goes with, as far as it is known before the task runs.

=========  ==========================================================================================
views      share of the picture that the object fills: the mean projected area of its box over the
           square of its diagonal (Cauchy: a quarter of the surface of a convex body)
modes      bending modes below the highest frequency, N = √3 S f / (h c), with S half the area, h the
           thin walls and c the longitudinal wave speed of a plate (Cremer and Heckl, Structure-Borne
           Sound): the finer it bends, the more unknowns
others     bytes of the first file read
=========  ==========================================================================================
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from objectfolder.errors import FormatError, InputError
from objectfolder.store import read_attributes
from pipeline.dataset.parameters import Parameters
from pipeline.dataset.records import read_records
from pipeline.dataset.stages import OBJECTS, STAGES

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
        self._measured: dict[str, Mapping[str, Any] | None] = {}
        self._materials: dict[str, Mapping[str, float]] | None = None

    def of(self, stage: str, object_id: str, size_bytes: int | None = None) -> float | None:
        """Return the load of a task; None where what it hangs on does not exist yet.

        Parameters
        ----------
        stage, object_id
            Whose task.
        size_bytes
            Bytes of the first file it reads, looked up where it is a product and not given.
        """
        if stage in ("views", "modes"):
            measured = self._measures(object_id)
            if measured is None:
                return None
            try:
                return (
                    self._bending_modes(object_id, measured) if stage == "modes" else picture_share(measured)
                )
            except (KeyError, TypeError, ValueError, ArithmeticError):
                return None  # a product that says of itself what cannot be
        if size_bytes is None and stage in STAGES and STAGES[stage].inputs:
            path = STAGES[stage].inputs[0].kind.path(self._root, object_id)
            size_bytes = path.stat().st_size if path.is_file() else None
        return size_bytes

    def _measures(self, object_id: str) -> Mapping[str, Any] | None:
        if object_id not in self._measured:
            path = OBJECTS.path(self._root, object_id)
            try:
                self._measured[object_id] = read_attributes(path) if path.is_file() else None
            except FormatError:
                self._measured[object_id] = None  # the run will say so
        return self._measured[object_id]

    def _bending_modes(self, object_id: str, measured: Mapping[str, Any]) -> float | None:
        if self._materials is None:
            try:
                rows = read_records(self._root).rows
            except InputError:
                rows = {}
            self._materials = {name: row["material"] for name, row in rows.items()}
        material = self._materials.get(object_id)
        return bending_modes(measured, material, self._frequency_hz) if material else None


def picture_share(measured: Mapping[str, Any]) -> float | None:
    """Return the share of a picture as wide as its diagonal that an object's box fills in the mean.

    Parameters
    ----------
    measured
        Attributes of the object's product.
    """
    a, b, c = (float(extent) for extent in measured["length"]["extents_m"])
    square = a * a + b * b + c * c
    return (a * b + b * c + c * a) / (2 * square) if square > 0 else None


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
