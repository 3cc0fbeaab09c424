"""What makes Object Files, and no query runs: meshes, truth, fits of networks, calibrations of sensors."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.making.encoding import encode_object
    from objectfolder.making.materials import Material, read_materials
    from objectfolder.making.mesh.ingest import ingest_object
    from objectfolder.making.mesh.readers.load import load_mesh
    from objectfolder.making.modes.modes import simulate_modes
    from objectfolder.making.sensor.calibration import fit_table
    from objectfolder.making.sensor.own_calibration import OwnCalibration, calibrate
    from objectfolder.making.touches.record import simulate_touches
    from objectfolder.making.views.views import simulate_views
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "encoding": ["encode_object"],
            "materials": ["Material", "read_materials"],
            "mesh.ingest": ["ingest_object"],
            "mesh.readers.load": ["load_mesh"],
            "modes.modes": ["simulate_modes"],
            "sensor.calibration": ["fit_table"],
            "sensor.own_calibration": ["OwnCalibration", "calibrate"],
            "touches.record": ["simulate_touches"],
            "views.views": ["simulate_views"],
        },
    )

__all__ = [
    "Material",
    "OwnCalibration",
    "calibrate",
    "encode_object",
    "fit_table",
    "ingest_object",
    "load_mesh",
    "read_materials",
    "simulate_modes",
    "simulate_touches",
    "simulate_views",
]
