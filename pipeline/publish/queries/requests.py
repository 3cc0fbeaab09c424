"""What commands ask of one object, with all options; light to import."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline.dataset.project_files import MATERIALS


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """Views to render.

    Parameters
    ----------
    views
        a number of views, drawn as the data set's are; or a .npy file, (n, 6): positions of camera and
        light, metres, object frame; (n, 3) with --light or --environment (default: 8, a turntable of 24)
    turntable
        pictures from all round in a studio's light, and turntable.gif of them
    seed
        of the draw
    frame
        of positions: metres as in Python, or the papers' with the object at the origin, longest side 1
    light
        X Y Z R G B: a light for all views, with linear colour factors (white: 1 1 1); may be given several
        times
    environment
        light all views by an equirectangular .exr or .hdr map of linear radiance, oriented as in Blender
    resolution
        pixels a side
    field_of_view_deg
        degrees
    sub_rays
        rays in an edge pixel: slower and closer (default 64)
    crop
        TOP LEFT HEIGHT WIDTH in pixels: render only this part of the image
    passes
        depth (0000_depth.npy, metres along the camera's axis), normal (0000_normal.npy, object frame),
        albedo (linear), roughness, metallic (0000_albedo.npy and so on) or mask (0000_mask.png); may be given
        several times
    """

    views: int | Path | None = None
    turntable: bool = False
    seed: int = 0
    frame: Literal["object", "unit"] = "object"
    light: tuple[tuple[float, float, float, float, float, float], ...] = ()
    environment: Path | None = None
    resolution: int = 256
    field_of_view_deg: float = 39.6
    sub_rays: int | None = None
    crop: tuple[int, int, int, int] | None = None
    passes: tuple[Literal["depth", "normal", "albedo", "roughness", "metallic", "mask"], ...] = ()


Beater = Literal["wood", "steel", "finger", "impulse"]


@dataclass(frozen=True, kw_only=True)
class Striking:
    """Points to strike.

    Parameters
    ----------
    points
        a number of points to draw, or a .npy file, (n, 3) metres, object frame
    forces
        .npy file, (n, 3) impulses in newton seconds, or (n, k, 3) newtons at the samples, in place of the
        speed of what strikes
    speed_m_s
        metres a second, along the inward normal, at which it strikes
    seed
        of the draw
    duration_s
        seconds
    sample_rate_hz
        hertz
    listener
        X Y Z, metres, object frame: write the pressure there (Pa, approximate), not surface velocity
        (m/s); twice for stereo
    support
        free, or lying as on a table, which lets every mode die sooner
    gain
        factor of what is written; 1 keeps m/s or Pa, which players clip (default: the loudest sound peaks
        3 dB below full scale)
    materials
        materials table (CSV)
    """

    points: int | Path = 8
    forces: Path | None = None
    speed_m_s: float = 1.0
    seed: int = 0
    duration_s: float = 2.0
    sample_rate_hz: int = 44100
    listener: tuple[tuple[float, float, float], ...] = ()
    support: Literal["free", "lying"] = "free"
    gain: float | None = None
    materials: Path = MATERIALS


@dataclass(frozen=True, kw_only=True)
class Pressing:
    """Points to press.

    Parameters
    ----------
    points
        a number of points to draw where the sensor fits, or a .npy file, (n, 3) metres, object frame
    anywhere
        draw points anywhere on the surface, also where the sensor does not fit
    seed
        of the draw
    tilt_deg
        degrees from the surface normal
    azimuth_deg
        degrees from the image's right to its top
    roll_deg
        degrees of the sensor about its own axis
    contact
        contact model (default: the file's own)
    resolution
        HEIGHT WIDTH in pixels (default: the sensor's)
    background
        image of a real sensor that nothing touches, to lay the touches over; 'synthetic' draws one
    noise_seed
        add the sensor's noise (default: none)
    """

    points: int | Path = 8
    anywhere: bool = False
    seed: int = 0
    tilt_deg: float = 0.0
    azimuth_deg: float = 0.0
    roll_deg: float = 0.0
    contact: Literal["rigid", "elastic"] | None = None
    resolution: tuple[int, int] | None = None
    background: str | None = None
    noise_seed: int | None = None


@dataclass(frozen=True, kw_only=True)
class MeshToSolve:
    """A mesh whose modes are solved.

    Parameters
    ----------
    material
        a row of the materials table: an Object File has its own, and a fit begins from it
    materials
        materials table (CSV)
    length_m
        longest side in metres (default: as in the file)
    max_frequency_hz
        hertz
    max_modes
        largest number of modes
    accuracy_cents
        wanted error of the frequencies
    wall_m
        least thickness of walls in metres, where a scan fused them
    shell_m
        wall of a vessel that was scanned solid, metres
    seed
        of what is drawn at random
    """

    material: str | None = None
    materials: Path = MATERIALS
    length_m: float | None = None
    max_frequency_hz: float = 20000.0
    max_modes: int = 256
    accuracy_cents: float = 5.0
    wall_m: float | None = None
    shell_m: float | None = None
    seed: int = 0


@dataclass(frozen=True, kw_only=True)
class ModesOfMesh(MeshToSolve):
    """Modes of a mesh to solve; an Object File has them.

    Parameters
    ----------
    damping
        law of the dampings: loss_factor, or rayleigh as in the papers
    radiation
        solved: dampings have what the air takes, or sphere: they are the material's alone
    """

    damping: Literal["loss_factor", "rayleigh"] = "loss_factor"
    radiation: Literal["solved", "sphere"] = "solved"


@dataclass(frozen=True, kw_only=True)
class FittingOfSound(MeshToSolve):
    """A mesh to fit to recordings of its object.

    Parameters
    ----------
    name
        of the fitted material (default: the mesh's)
    mass_kg
        measured: gives the density (default: the table's density, for a recording tells E / rho alone)
    hold_wall
        keep the mesh's walls: the fitted material is then the one with which this mesh sounds best as it is
    """

    name: str | None = None
    mass_kg: float | None = None
    hold_wall: bool = False


@dataclass(frozen=True, kw_only=True)
class Exporting:
    """An export of views, of a surface, or of what simulators need.

    Parameters
    ----------
    format
        nerf, colmap or gltf; for simulators mjcf, urdf, sdf, usd or all; or the format of a plugin
    overwrite
        replace what an earlier run wrote there
    frame
        nerf, colmap: longest side 1 and centred, or metres
    exr
        nerf, colmap: also write scene-linear OpenEXR images
    points
        colmap: surface points to draw
    seed
        colmap: seed of the points; simulators: of convex parts and of a scene's places
    surface
        gltf, simulators: the compressed surface of the Object File, or the source mesh (default: the stored
        one where there is an Object File; for simulators the source's where it is at hand)
    colour
        gltf, stored surface: what VisionNet learned, or the source's texture (default where there is one)
    texture_side
        gltf: texels a side
    vertex_colours
        gltf, stored surface: a colour for each vertex and no texture
    roughness
        gltf: in place of the material's
    metallic
        gltf: in place of the material's
    materials
        materials table (CSV)
    mass_kg
        simulators: a measured mass; the inertia follows (default: that of the solid)
    friction
        simulators: coefficient of sliding friction, in place of the material's
    restitution
        simulators: in place of the material's
    most_parts
        simulators: largest number of convex parts for collisions (default: the parts of the data set, else
        16)
    threshold_m
        simulators: concavity that a part may have, metres (default: the parts of the data set, else what fits
        the object)
    """

    format: str
    overwrite: bool = False
    frame: Literal["unit", "object"] = "unit"
    exr: bool = False
    points: int = 5000
    seed: int = 0
    surface: Literal["stored", "source"] | None = None
    colour: Literal["network", "source"] | None = None
    texture_side: int = 1024
    vertex_colours: bool = False
    roughness: float | None = None
    metallic: float | None = None
    materials: Path = MATERIALS
    mass_kg: float | None = None
    friction: float | None = None
    restitution: float | None = None
    most_parts: int | None = None
    threshold_m: float | None = None
