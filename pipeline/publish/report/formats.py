"""How numbers, licences and sources are printed on the page."""

import math
import re
from typing import Any

from pipeline.publish.cards.licences import Licence

NOTHING = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"


def number(value: Any, decimals: int = 1) -> str:
    """Return a number with a fixed count of decimals and a true minus sign; a dash for None."""
    if value is None or not math.isfinite(value):
        return NOTHING
    text = f"{float(value):,.{decimals}f}".replace(",", "\u202f")
    return text.replace("-", MINUS) if float(f"{value:.{decimals}f}") else text.lstrip("-")


def digits(value: Any, count: int = 3) -> str:
    """Return a number to a count of significant digits."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value and not 1e-4 <= abs(value) < 1e6:
        mantissa, exponent = f"{value:.{count - 1}e}".split("e")
        superscripts = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
        return f"{mantissa} {TIMES} 10{str(int(exponent)).translate(superscripts)}".replace("-", MINUS)
    decimals = max(0, count - 1 - math.floor(math.log10(abs(value)))) if value else 0
    return number(value, decimals)


def megabytes(size: Any) -> str:
    """Return bytes in MB (a million bytes), in whole kB below one."""
    if size is None:
        return NOTHING
    return f"{number(size / 1e3, 0)} kB" if size < 999_500 else f"{number(size / 1e6, 2)} MB"


def seconds(value: float) -> str:
    """Return seconds with a unit that keeps the number short."""
    for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= size * 0.9999:
            return f"{value / size:.3g} {unit}"
    return f"{value * 1e9:.3g} ns"


def percent(share: Any) -> str:
    """Return a share of one in percent."""
    return NOTHING if share is None else f"{number(100 * share, 1 if share < 0.1 else 0)} %"


def licence_link(licence: Any) -> str | None:
    """Return the address of a known licence's text, or the address that `licence` itself is."""
    return web_link(Licence.of(str(licence or "")).url)


def web_link(text: Any) -> str | None:
    """Return `text` where it is a web address and nothing else, else None."""
    address = str(text or "").strip()
    return address if re.fullmatch(r"https?://[^\s\"'<>]+", address) else None
