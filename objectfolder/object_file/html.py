"""An Object File in a notebook: a picture, a strike to play, its fidelity and its licence."""

import html
from collections.abc import Mapping
from typing import Any

from objectfolder.audio.synthesis.sound_queries import SoundQueries
from objectfolder.audio.synthesis.wav import wav_bytes
from objectfolder.notebook import data_uri, png_bytes
from objectfolder.vision.visionnet.sight_queries import SightQueries

SIDE_PX = 256
DURATION_S, SAMPLE_RATE_HZ = 1.0, 44100


def notebook_card(sight: SightQueries, sound: SoundQueries, description: Mapping[str, Any]) -> str:
    """Return HTML that needs no network and no script.

    Parameters
    ----------
    sight, sound, description
        Of an Object File.
    """
    described = description["object"]
    stated = ("name", "licence", "attribution")
    name, licence, author = (html.escape(str(described.get(key) or "not stated")) for key in stated)
    material = html.escape(str((description["material"] or {}).get("name", "unknown material")))
    picture = data_uri("image/png", png_bytes(sight.pictures(1, SIDE_PX)[0]))
    player = "no sound" if sound.net.absent else "no audible mode"
    if len(sound.net.frequencies_hz):
        point = sound.contacts.surface.sample(1, seed=0).points
        strike = sound.strike(point, None, DURATION_S, SAMPLE_RATE_HZ)
        wav = data_uri("audio/wav", wav_bytes(strike, SAMPLE_RATE_HZ)[0])
        player = f'<audio controls src="{wav}"></audio>'
    figures = "<br>".join(_figures(description["fidelity"]))
    return (
        f'<div style="display:flex;gap:1em;align-items:center;font-family:sans-serif">'
        f'<img src="{picture}" width="{SIDE_PX}" height="{SIDE_PX}" alt="{name}">'
        f"<div><b>{name}</b>, {material}<br>{player}<br>{figures}<br>licence {licence}; {author}</div></div>"
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
