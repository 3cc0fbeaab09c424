"""The page of an ABX listening test: one file that works from disk, without a network.

    python -m docs.listening.page mug bell --root set -o listen.html

In each trial truth and Object File are struck alike at a held-out point, at one level. Objects are all that
are audible where none is named.
"""

import argparse
import base64
import itertools
import random
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import InputError, ObjectFolderError
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from objectfolder.products.atomic import write_whole
from pipeline.dataset.products import read_description
from pipeline.dataset.stages import MODES, OBJECT_FILES
from pipeline.publish.report.templates import security_policy, template_environment

TEMPLATES = Path(__file__).parent / "template"
SCRIPTS = ("abx.js", "listen.js")
FADE_S = 0.01
PEAK = 0.5
LARGEST_SEED = 999_999_999  # a page takes up to nine digits
SHORTEST_S, LONGEST_S = 0.05, 10.0
LEVEL_RULE = (
    "The Object File's sound is scaled to the root mean square of the truth's; then one factor brings the "
    "larger peak of the two to half of full scale. The last 10 ms fade out; 16 bits."
)


@dataclass(frozen=True)
class Pair:
    """One strike at a held-out point, row `query` of the product of modes, as both make it sound.

    Sounds are (samples,) int16 after levels are matched, see `LEVEL_RULE`; the Object File's was made louder
    by `level_change_db`. A fingerprint is empty where the pipeline did not write the product.
    """

    object_id: str
    query: int
    truth: np.ndarray
    object_file: np.ndarray
    level_change_db: float
    truth_fingerprint: str
    object_file_fingerprint: str


def page_text(pairs: Sequence[Pair], seed: int) -> str:
    """Return the page: equal pairs and seeds give equal bytes."""
    environment = template_environment(TEMPLATES)
    content = {
        "software": f"ObjectFolder Factory {objectfolder.__version__}",
        "seed": seed,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "level_rule": LEVEL_RULE,
        "pairs": [
            {**vars(pair), "truth": _base64(pair.truth), "object_file": _base64(pair.object_file)}
            for pair in pairs
        ],
    }
    return environment.get_template("listen.html.j2").render(
        policy=security_policy(environment, SCRIPTS),
        test=content,
        objects=len({pair.object_id for pair in pairs}),
    )


def draw_pairs(
    root: Path, count: int, seed: int, *, objects: Sequence[str] | None = None, duration_s: float = 1.0
) -> list[Pair]:
    """Draw strikes at held-out points of a data set: every audible object about as often as the others.

    Parameters
    ----------
    root
        Root of a data set with its modes and Object Files.
    count
        How many; no strike comes twice.
    seed
        Of the draw.
    objects
        Ids; all of the data set if None.

    Raises
    ------
    InputError
        No audible object, too few held-out points, an id that is not there, or a silent strike.
    """
    audible = ObjectFolderDataset(root, "audio", "held_out", "object_file", objects=objects).object_ids
    settings: dict[str, Any] = {
        "objects": audible, "duration_s": duration_s, "sample_rate_hz": SAMPLE_RATE_HZ,
    }  # fmt: skip
    truth = ObjectFolderDataset(root, "audio", "held_out", "truth", **settings)
    answer = ObjectFolderDataset(root, "audio", "held_out", "object_file", **settings)
    if len(truth) < count:
        finding = f"{len(truth)} held-out strikes of {len(audible)} audible objects for {count}"
        raise InputError(str(root), finding, "Ask for fewer trials.")
    chance = random.Random(seed)
    of_objects = itertools.groupby(range(len(truth)), lambda index: truth.place(index)[0])
    shuffled = [chance.sample(strikes, len(strikes)) for strikes in (list(group) for _, group in of_objects)]
    chance.shuffle(shuffled)
    # One strike of each object in turn.
    turns = itertools.chain.from_iterable(itertools.zip_longest(*shuffled))
    indices = [index for index in turns if index is not None][:count]
    pairs = []
    for index in sorted(indices):
        object_id, query = truth.place(index)
        try:
            levelled = match(truth[index]["sound"].numpy(), answer[index]["sound"].numpy())
        except ValueError as error:
            where, finding = f"{object_id}, query {query}", f"cannot be compared by ear: {error}"
            raise InputError(where, finding, "Name the other objects, or another --seed.") from error
        files = (MODES.path(root, object_id), OBJECT_FILES.path(root, object_id))
        fingerprints = [str(read_description(path).get("fingerprint", "")) for path in files]
        pairs.append(Pair(object_id, query, *levelled, *fingerprints))
    return pairs


def match(truth: np.ndarray, answer: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return both sounds as int16 by `LEVEL_RULE`, and the change of the second, dB.

    Raises
    ------
    ValueError
        Silence: it has no level.
    """
    sounds = np.stack([truth, answer]).astype(np.float64)
    levels = np.sqrt(np.mean(sounds**2, axis=1))
    if not levels.all():
        raise ValueError("silence has no level")
    ratio = levels[0] / levels[1]
    sounds[1] *= ratio
    sounds *= PEAK / np.abs(sounds).max()
    fade = min(round(FADE_S * SAMPLE_RATE_HZ), sounds.shape[1])
    sounds[:, sounds.shape[1] - fade :] *= np.linspace(1.0, 0.0, fade)
    levelled = np.round(sounds * 32767).astype("<i2")
    return levelled[0], levelled[1], round(float(20 * np.log10(ratio)), 3)


def _base64(sound: np.ndarray) -> str:
    return base64.b64encode(sound.tobytes()).decode()


def main(words: Sequence[str] | None = None) -> int:
    """Write a page; return the exit status."""
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("docs.listening.page", description=__doc__, formatter_class=formatter)
    parser.add_argument("ids", nargs="*", help="objects")
    parser.add_argument("--root", type=Path, default=Path(), help="data set with modes and object_files")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the page")
    parser.add_argument("--trials", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0, help="of the draw, 0 to 999999999")
    parser.add_argument("--duration", type=float, default=1.0, help="seconds of each sound")
    options = parser.parse_args(words)
    if not (
        options.trials > 0
        and 0 <= options.seed <= LARGEST_SEED
        and SHORTEST_S <= options.duration <= LONGEST_S
    ):
        parser.error("--trials is at least 1, --seed has up to nine digits, --duration is .05 to 10")
    try:
        pairs = draw_pairs(
            options.root,
            options.trials,
            options.seed,
            objects=options.ids or None,
            duration_s=options.duration,
        )
        write_whole(options.output, page_text(pairs, options.seed))
    except ObjectFolderError as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{options.output}: {len(pairs)} trials; open it in a browser")
    return 0


if __name__ == "__main__":
    sys.exit(main())
