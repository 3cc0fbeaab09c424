"""Modes that nobody hears are not sounded."""

from collections.abc import Sequence

import numpy as np

from objectfolder.audio.synthesis.audibility import Audibility
from objectfolder.audio.synthesis.object_stream import ObjectStream

BLOCKS_BETWEEN = 8  # 93 ms of the default blocks: what covers another mode hardly decays meanwhile


class Culling:
    """Chooses from block to block which modes of some streams are heard beside each other.

    Parameters
    ----------
    streams
        At one listener.

    Attributes
    ----------
    ringing, sounded : modes that rang at each choice so far, and those of them that were heard, summed up
    """

    def __init__(self, streams: Sequence[ObjectStream]) -> None:
        self._streams = streams
        self._audibility = Audibility(np.concatenate([stream.loudness()[0] for stream in streams]))
        self._blocks = self.ringing = self.sounded = 0

    def choose(self) -> None:
        """Choose for the next block."""
        self._blocks += 1
        if self._blocks % BLOCKS_BETWEEN == 0:
            amplitudes = [stream.loudness()[1] for stream in self._streams]
            heard = self._audibility.heard(np.concatenate(amplitudes))
            borders = np.cumsum([len(amplitude) for amplitude in amplitudes])[:-1]
            for stream, some in zip(self._streams, np.split(heard, borders), strict=True):
                stream.keep(some)
            self.ringing += int(np.count_nonzero(np.concatenate(amplitudes)))
            self.sounded += int(heard.sum())
