"""Sound from modes: the mode bank, forces, contacts, streams, and what reaches a listener."""

from objectfolder.audio.synthesis.air import Air, Listener
from objectfolder.audio.synthesis.bank import driven_bank, mode_bank
from objectfolder.audio.synthesis.hertz import ContactBody, HertzContact, mass_at_contact
from objectfolder.audio.synthesis.support import Support
from objectfolder.audio.synthesis.voices import Voices
from objectfolder.audio.synthesis.wav import listening_gain, write_wav

__all__ = [
    "Air",
    "ContactBody",
    "HertzContact",
    "Listener",
    "Support",
    "Voices",
    "driven_bank",
    "listening_gain",
    "mass_at_contact",
    "mode_bank",
    "write_wav",
]
