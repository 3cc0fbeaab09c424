"""Wrong usage in a line: the command, the option or argument, and what to write."""

import re

from cyclopts import CoercionError, CycloptsError, MissingArgumentError, UnusedCliTokensError

from objectfolder.errors import InputError

# Units that people write with a number, by the end of the parameter's name: their factors to that unit.
UNITS = {
    "m": ("metres", {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}),
    "kg": ("kilograms", {"g": 1e-3, "kg": 1.0}),
    "m_s": ("metres a second", {"cm/s": 1e-2, "m/s": 1.0}),
    "s": ("seconds", {"ms": 1e-3, "s": 1.0}),
    "hz": ("hertz", {"hz": 1.0, "khz": 1e3}),
    "n": ("newtons", {"n": 1.0, "mn": 1e-3}),
    "deg": ("degrees", {"deg": 1.0, "°": 1.0}),
}
# Of a value among several of an option, whose kinds differ.
ANY_UNIT = {symbol: factor for _, factors in UNITS.values() for symbol, factor in factors.items()}
NUMBER_AND_UNIT = re.compile(r"\s*([-+]?[\d.]+(?:e[-+]?\d+)?)\s*([^\d\s.]+)\s*", re.IGNORECASE)


class UsageError(InputError):
    """Arguments that say nothing that the command could do."""


def usage_line(error: CycloptsError) -> str:
    """Return what is wrong with the words of a command, and the remedy."""
    command = " ".join(error.command_chain or ())
    where = f"{command}: " if command else ""
    more = f"See objectfolder {f'{command} ' if command else ''}--help."
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        if error.keyword is not None:  # written, with too few values
            count, _ = error.argument.token_count()
            values = "a value" if count == 1 else f"{count} values"
            number = len(error.tokens_so_far) % count or "none"
            return f"{where}{error.keyword} takes {values}, {number} given. {more}"
        return f"{where}{error.argument.name} is missing. {_materials(error.argument.name) or more}"
    if isinstance(error, UnusedCliTokensError):
        words = ", ".join(error.unused_tokens or ())
        return f"{where}{words}: more arguments than the command takes. {more}"
    if isinstance(error, CoercionError) and error.argument is not None and error.token is not None:
        field = error.argument.field_info.name
        unit = UNITS.get("m_s" if field.endswith("_m_s") else field.rpartition("_")[2])
        if unit is not None or error.target_type is float:
            name, factors = unit or ("", ANY_UNIT)
            finding = (
                f"{error.argument.name} {error.token.value}: not a number{f' of {name}' if name else ''}"
            )
            return f"{where}{finding}. {_converted(error.token.value, factors) or more}"
    return f"{where}{error} {more}"


def _converted(text: str, factors: dict[str, float]) -> str | None:
    """Return the remedy for a number with a unit that is known."""
    match = NUMBER_AND_UNIT.fullmatch(text)
    factor = factors.get(match[2].lower()) if match else None
    if match is None or factor is None:
        return None
    try:
        return f"Write {float(match[1]) * factor:.6g}."
    except ValueError:
        return None


def _materials(option: str) -> str | None:
    """Return the materials to choose from, where the material is missing."""
    if option != "--material":
        return None
    from objectfolder.making.materials import read_materials
    from pipeline.dataset.project_files import MATERIALS

    return f"Materials are {', '.join(sorted(read_materials(MATERIALS)))}."
