"""An Object File in a notebook: a picture, a strike to play, its fidelity and its licence."""

import html
from abc import abstractmethod
from typing import Any

import numpy as np

from objectfolder.audio.synthesis.sound_queries import SoundQueries
from objectfolder.audio.synthesis.wav import wav_bytes
from objectfolder.notebook import data_uri, png_bytes
from objectfolder.vision.visionnet.sight_queries import SightQueries

SIDE_PX = 256
DURATION_S, SAMPLE_RATE_HZ = 1.0, 44100


class NotebookCard(SightQueries, SoundQueries):
    """What a notebook shows; a part of `ObjectFile`."""

    @abstractmethod
    def sample_contacts(
        self, n: int = 1, seed: int = 0, *, reachable: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Draw contacts; see `ObjectFile.sample_contacts`."""

    def _repr_html_(self) -> str:
        """Return HTML that needs no network and no script."""
        said = self.description["object"]
        stated = ("name", "licence", "attribution")
        name, licence, by = (html.escape(str(said.get(key) or "not stated")) for key in stated)
        material = html.escape(str((self.description["material"] or {}).get("name", "unknown material")))
        picture = data_uri("image/png", png_bytes(self.pictures(1, SIDE_PX)[0]))
        heard = "no sound" if self.modes.absent else "no audible mode"
        if len(self.modes.frequencies_hz):
            points, _ = self.sample_contacts(reachable=False)
            sound = self.strike(points, None, DURATION_S, SAMPLE_RATE_HZ)
            wav = data_uri("audio/wav", wav_bytes(sound, SAMPLE_RATE_HZ)[0])
            heard = f'<audio controls src="{wav}"></audio>'
        figures = "<br>".join(_figures(self.description["fidelity"]))
        return (
            f'<div style="display:flex;gap:1em;align-items:center;font-family:sans-serif">'
            f'<img src="{picture}" width="{SIDE_PX}" height="{SIDE_PX}" alt="{name}">'
            f"<div><b>{name}</b>, {material}<br>{heard}<br>{figures}<br>licence {licence}; {by}</div></div>"
        )


def _figures(fidelity: Any) -> list[str]:
    """Return the fidelity of each sense on held-out queries."""
    if not fidelity:
        return ["fidelity not measured"]
    audio = (
        f"{fidelity['audio']['gain_error_db']:.1f} dB of gain error"
        if fidelity["audio"]["audible"]
        else "none"
    )
    sight, touch = (
        "unknown" if value is None else f"{value:.1f} dB"
        for value in (fidelity["vision"]["psnr_foreground_db"], fidelity["touch"]["psnr_contact_db"])
    )
    return [f"sight {sight} in the foreground", f"sound {audio}", f"touch {touch} in contact"]
