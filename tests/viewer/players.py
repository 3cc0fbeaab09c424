"""What the tests of both players do with a page."""

import base64
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from objectfolder.object_file import ObjectFile

PANEL = "document.querySelector('.player').objectfolderPanel"
HOSTILE = '<img src=x onerror="window.hacked=1"></script><script>window.hacked=1</script>'


def evaluated(page: Any, expression: str) -> Any:
    """Value of an expression in which ``panel`` is the player."""
    return page.evaluate(f"() => {{ const panel = {PANEL}; return {expression}; }}")


def place_of(page: Any, x: float, y: float) -> tuple[float, float]:
    """Window coordinates of a place in the image."""
    image = page.locator(".player-image")
    image.scroll_into_view_if_needed()
    box = image.bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def touched(page: Any, kind: str, act: Callable[[], Any]) -> dict[str, Any]:
    """Do something that strikes or presses; return the answer, arrays as lists."""
    page.evaluate(
        """(kind) => { window.touched = new Promise((done) => document.addEventListener(
        `player:${kind}`, ({ detail }) => done(JSON.stringify(detail.answer,
            (_, value) => ArrayBuffer.isView(value) ? Array.from(value) : value)), { once: true })); }""",
        kind,
    )
    act()
    answer: dict[str, Any] = json.loads(page.evaluate("() => window.touched"))
    return answer


def click(page: Any, x: float = 0.5, y: float = 0.5) -> None:
    page.mouse.click(*place_of(page, x, y))


def drag(page: Any, across: float, *, shift: bool = False) -> None:
    """Drag from the middle to the right by a share of the width."""
    if shift:
        page.keyboard.down("Shift")
    page.mouse.move(*place_of(page, 0.5, 0.5))
    page.mouse.down()
    page.mouse.move(*place_of(page, 0.5 + across / 2, 0.5))
    page.mouse.move(*place_of(page, 0.5 + across, 0.5))
    page.mouse.up()
    if shift:
        page.keyboard.up("Shift")


def pixels(page: Any) -> np.ndarray:
    """The image (height, width, 3) uint8, of either kind of canvas; opaque, so PNG keeps it as it is."""
    address = page.evaluate("() => document.querySelector('.player-image').toDataURL('image/png')")
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
        return np.asarray(image.convert("RGB"))


def python_answers(page: Any, *, image: bool = True, pixels: str = r"\g<0>") -> dict[str, Any]:
    """Run the Python that the page shows; return its variables.

    Where nobody compares its image, this is left out, or has a number of pixels a side of its own.
    """
    names: dict[str, Any] = {}
    lines = page.locator(".player-python code").text_content().splitlines()
    code = "\n".join(line for line in lines if image or not line.startswith("image = "))
    exec(re.sub(r"(?<=resolution=)\d+", pixels, code), names)
    return names


def hostile_copy(file: Path, target: Path) -> Path:
    """An Object File whose every text would run if it were taken for markup."""
    opened = ObjectFile.load(file)
    described = dict.fromkeys(("name", "source", "licence", "attribution"), HOSTILE) | {"id": HOSTILE}
    material = opened.description["material"] | {"name": HOSTILE}
    opened.with_description(object=described, material=material).save(target)
    return target


def spectral_peaks(sound: np.ndarray, rate: float, near_hz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequency and level (dB) of the highest peak within 20 cents of each frequency.

    Hann's window and a parabola through the logarithm of three lines.
    """
    count = 8 * len(sound)
    magnitude = np.abs(np.fft.rfft(sound * np.hanning(2 * len(sound))[len(sound) :], count))
    level = 20 * np.log10(np.maximum(magnitude, 1e-30))
    step = rate / count
    frequencies, levels = [], []
    for frequency_hz in near_hz:
        low, high = (int(frequency_hz * 2 ** (cents / 1200) / step) for cents in (-20, 20))
        top = low + int(np.argmax(level[low : high + 2]))
        a, b, c = level[top - 1 : top + 2]
        shift = 0.5 * (a - c) / (a - 2 * b + c)
        frequencies.append((top + shift) * step)
        levels.append(b - 0.25 * (a - c) * shift)
    return np.array(frequencies), np.array(levels)
