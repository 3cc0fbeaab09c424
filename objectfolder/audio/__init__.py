"""Modes of vibration as an Object File holds them, and the sound that they make."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.audio.synthesis.air import Air, Listener
    from objectfolder.audio.synthesis.bank import driven_bank, mode_bank
    from objectfolder.audio.synthesis.hertz import ContactBody, HertzContact, mass_at_contact
    from objectfolder.audio.synthesis.object_stream import ObjectStream
    from objectfolder.audio.synthesis.sound import Sound, StrikeEnergy
    from objectfolder.audio.synthesis.sound_queries import SoundQueries
    from objectfolder.audio.synthesis.support import Support
    from objectfolder.audio.synthesis.voices import Voices
    from objectfolder.audio.synthesis.wav import listening_gain, write_wav
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "synthesis.air": ["Air", "Listener"],
            "synthesis.bank": ["driven_bank", "mode_bank"],
            "synthesis.hertz": ["ContactBody", "HertzContact", "mass_at_contact"],
            "synthesis.object_stream": ["ObjectStream"],
            "synthesis.sound": ["Sound", "StrikeEnergy"],
            "synthesis.sound_queries": ["SoundQueries"],
            "synthesis.support": ["Support"],
            "synthesis.voices": ["Voices"],
            "synthesis.wav": ["listening_gain", "write_wav"],
        },
        {"objectfolder.making": ["Material", "read_materials", "simulate_modes"]},
    )

__all__ = [
    "Air",
    "ContactBody",
    "HertzContact",
    "Listener",
    "ObjectStream",
    "Sound",
    "SoundQueries",
    "StrikeEnergy",
    "Support",
    "Voices",
    "driven_bank",
    "listening_gain",
    "mass_at_contact",
    "mode_bank",
    "write_wav",
]
