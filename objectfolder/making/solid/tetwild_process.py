"""Child process that fills a surface: ``python -m objectfolder.making.solid.tetwild_process IN OUT``.

A process of its own because the filling is native code without a way to stop it. IN and OUT are .npz files:
IN holds `vertices`, `faces` and the numbers of `tetwild.Envelope`; OUT holds `vertices`, `tetrahedra`, the
faces the surface was simplified to, by how much it moved, and the edge that was asked for.

fTetWild shuffles its work with generators seeded from the machine's entropy and offers no seed, so the
same surface gives other tetrahedra at every run. Here the entry of the loaded library's linkage table
that leads to ``std::random_device`` is pointed at a function that returns a stated number. It is done on
Linux, where shared libraries are ELF files.
"""

import ctypes
import mmap
import os
import resource
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytetwild
import pyvista
from numpy.typing import NDArray
from pytetwild import PyfTetWildWrapper

from objectfolder.child_process import end_with, limit_cpu_time
from objectfolder.errors import SimulationError
from objectfolder.surface.surface import Surface

GET_VALUE = b"_ZNSt13random_device9_M_getvalEv"
SECTION_DYNAMIC_SYMBOLS, SECTION_RELOCATIONS = 11, 4
SECTION_HEADER = struct.Struct("<IIQQQQIIQQ")
RELOCATION = struct.Struct("<QQq")
SYMBOL = struct.Struct("<IBBHQQ")
PROTECT_READ_WRITE = 3

# Native code keeps the address of the function: it must not be collected.
_kept: list[Any] = []


def seed_random_device(library: Path, seed: int) -> None:
    """Make every ``std::random_device`` that `library` uses return `seed`; the library must be loaded.

    Parameters
    ----------
    library
        The shared library (an extension module).
    seed
        From 0 to 2^32 - 1.

    Raises
    ------
    SimulationError
        The library is no 64-bit ELF file, is not loaded, or does not import the function by name.
    """
    function = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_void_p)(lambda _: seed)
    address = ctypes.cast(function, ctypes.c_void_p).value
    offsets = list(_linkage_slots(library.read_bytes(), GET_VALUE, str(library)))
    if not offsets:
        raise SimulationError(
            str(library), "does not import std::random_device", "Use the version of requirements.lock."
        )
    base = _load_address(library)
    page = mmap.PAGESIZE
    protect: Callable[..., int] = ctypes.CDLL(None, use_errno=True).mprotect
    for offset in offsets:
        slot = base + offset
        start = slot // page * page
        length = ctypes.c_size_t(slot + 8 - start)
        if protect(ctypes.c_void_p(start), length, PROTECT_READ_WRITE) != 0:
            raise SimulationError(str(library), "its linkage table cannot be written", "Report this.")
        ctypes.c_uint64.from_address(slot).value = address or 0
    _kept.append(function)


def _linkage_slots(data: bytes, name: bytes, where: str) -> Iterator[int]:
    """Offsets, from the load address, of the pointers that the loader fills with the symbol `name`."""
    if data[:5] != b"\x7fELF\x02":
        raise SimulationError(where, "not a 64-bit ELF library", "Tetrahedra are made on Linux.")
    table_offset = struct.unpack_from("<Q", data, 40)[0]
    entry_size, count = struct.unpack_from("<HH", data, 58)
    sections = [SECTION_HEADER.unpack_from(data, table_offset + index * entry_size) for index in range(count)]
    for _, kind, _, _, offset, size, link, *_ in sections:
        if kind != SECTION_RELOCATIONS or sections[link][1] != SECTION_DYNAMIC_SYMBOLS:
            continue
        symbols_at, strings_at = sections[link][4], sections[sections[link][6]][4]
        for position in range(offset, offset + size, RELOCATION.size):
            target, info, _ = RELOCATION.unpack_from(data, position)
            symbol = SYMBOL.unpack_from(data, symbols_at + (info >> 32) * SYMBOL.size)
            start = strings_at + symbol[0]
            if data[start : start + len(name) + 1] == name + b"\0":
                yield target


def _load_address(library: Path) -> int:
    """Where the first segment of a loaded library lies in this process."""
    target = str(library.resolve())
    for line in Path("/proc/self/maps").read_text().splitlines():
        fields = line.split(maxsplit=5)
        if len(fields) == 6 and fields[5] == target and int(fields[2], 16) == 0:
            return int(fields[0].partition("-")[0], 16)
    raise SimulationError(str(library), "not loaded", "Import it first.")


Floats = NDArray[np.float64]
# Faces over those aimed at, from which on elements are as many as order 4 is solved for: longer ones will do.
MANY_FACES = 1.8


def simplify(surface: Surface, target_faces: int, most_faces: int, allowed: float) -> tuple[Surface, float]:
    """Fewest faces (from `target_faces` on, 1.4 times a step) that keep the surface, and its rms movement.

    Quadric edge collapse (VTK). The measure is the root mean square over area of the distance between the two
    surfaces, both ways. Kept means within `allowed` and 1 % of the volume; from `most_faces` on, where more
    faces would cost more than they bring, within 2.5 times as much. A surface that cannot be kept is left
    as it is, with distance 0.
    """
    faces = target_faces
    volume = _signed_volume(surface)
    drawn = surface.sample(1024, 0).points
    while faces < len(surface.faces):
        mesh = pyvista.PolyData.from_regular_faces(surface.vertices, surface.faces)
        reduced = mesh.decimate(1 - faces / len(surface.faces), volume_preservation=True)
        candidate = Surface(np.asarray(reduced.points, dtype=np.float64), reduced.faces.reshape(-1, 4)[:, 1:])
        forth = candidate.sampled_distance.nearest(drawn)[1]
        back = surface.sampled_distance.nearest(candidate.sample(1024, 1).points)[1]
        moved = float(np.sqrt(np.mean(np.concatenate([forth, back]) ** 2)))
        patience = 2.5 if faces >= most_faces else 1.0
        lost = abs(_signed_volume(candidate) - volume)
        if moved <= patience * allowed and lost <= 0.01 * patience * abs(volume):
            return candidate, moved
        faces = most_faces if faces < most_faces < 1.4 * faces else int(1.4 * faces)
    return surface, 0.0


def _signed_volume(surface: Surface) -> float:
    corner = surface.vertices[surface.faces] - surface.bounds.mean(axis=0)
    return float(np.linalg.det(corner).sum() / 6)


def main(source: str, target: str) -> None:
    """Read, simplify, fill, write."""
    inputs = np.load(source)
    limit_cpu_time(int(inputs["time_limit_s"]))
    most = int(inputs["memory_limit"])
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    surface = Surface(inputs["vertices"], inputs["faces"])
    diagonal = float(np.linalg.norm(np.ptp(surface.bounds, axis=0)))
    seed_random_device(Path(PyfTetWildWrapper.__file__), 0)
    simple, moved = simplify(
        surface, int(inputs["target_faces"]), int(inputs["most_faces"]), float(inputs["allowed"])
    )
    many = len(simple.faces) >= MANY_FACES * int(inputs["target_faces"])
    edge = float(inputs["edge_length" if many else "wave_edge"])
    vertices, tetrahedra = pytetwild.tetrahedralize(
        simple.vertices,
        simple.faces.astype(np.int32),
        edge_length_fac=edge / diagonal,
        epsilon=float(inputs["epsilon"]) / diagonal,
        stop_energy=float(inputs["stop_energy"]),
        num_threads=1,
        quiet=True,
    )
    np.savez(
        target, vertices=vertices, tetrahedra=tetrahedra, faces=len(simple.faces), moved=moved, edge=edge
    )


if __name__ == "__main__":
    end_with(os.getppid())
    main(sys.argv[1], sys.argv[2])
