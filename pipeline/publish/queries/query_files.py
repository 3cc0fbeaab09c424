"""Files of queries, and folders for their answers."""

from pathlib import Path

import numpy as np

import objectfolder
from objectfolder.errors import InputError


def read_numbers(
    path: Path, columns: tuple[int, ...], dimensions: tuple[int, ...] = (2,), remedy: str = ""
) -> np.ndarray:
    """Read an array of finite numbers from an ``.npy`` file as float64; pickles are refused.

    Parameters
    ----------
    path
        The file.
    columns
        Allowed lengths of the last axis.
    dimensions
        Allowed numbers of axes.
    remedy
        What to do about another shape; by default it names the shape.

    Raises
    ------
    InputError
        Not an array of numbers, another shape, or values that are not finite.
    """
    try:
        values = np.load(path, allow_pickle=False)
    except ValueError as error:
        finding = f"not an .npy file of numbers ({error})"
        raise InputError(str(path), finding, "Write it with numpy.save.") from error
    remedy = remedy or f"Give an (n, {columns[0]}) array of numbers."
    if values.ndim not in dimensions or values.shape[-1] not in columns:
        raise InputError(str(path), f"shape {values.shape}", remedy)
    if not np.issubdtype(values.dtype, np.number):
        raise InputError(str(path), f"values of type {values.dtype}", remedy)
    if not np.isfinite(values).all():
        raise InputError(str(path), "holds values that are not finite", "Give numbers.")
    return np.asarray(values, dtype=np.float64)


def made_folder(folder: Path) -> Path:
    """Return a folder for answers, made if absent.

    Raises
    ------
    InputError
        It is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(str(folder), "is a file", "Give a folder for --output.")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def sample_queries(path: Path, views: int, contacts: int, seed: int, output: Path) -> str:
    """Write valid queries of an Object File; return what was done, in a line.

    Views are in the unit frame, as the published tools have them; contacts in metres, object frame.
    """
    file = objectfolder.load(path)
    cameras, lights = file.sample_views(views, seed)
    points, normals = file.sample_contacts(contacts, seed)
    drawn = np.concatenate([file.frame.to_unit(cameras[:, :3, 3]), file.frame.to_unit(lights)], axis=1)
    folder = made_folder(output)
    np.save(folder / "views.npy", drawn)
    np.save(folder / "points.npy", points)
    np.save(folder / "forces.npy", -normals)
    return f"{folder}: views.npy {drawn.shape}, points.npy and forces.npy {points.shape} (1 N s inwards)"
