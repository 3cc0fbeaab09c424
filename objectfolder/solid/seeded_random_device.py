"""Give a seed to native code that draws its seeds from ``std::random_device``.

fTetWild shuffles its work with generators seeded from the machine's entropy and offers no seed, so the
same surface gives other tetrahedra at every run. Here the entry of the loaded library's linkage table
that leads to ``std::random_device`` is pointed at a function that returns a stated number. It is done in
a process of its own (see `tetwild_process`), on Linux, where shared libraries are ELF files.
"""

import ctypes
import mmap
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from objectfolder.errors import SimulationError

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
