"""The page of a listening test: one file that works from disk, without a network."""

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

import objectfolder
from objectfolder.atomic import atomic_write
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from pipeline.publish.listening.stimuli import LEVEL_RULE, Pair, draw_pairs
from pipeline.publish.report.templates import security_policy, template_environment

TEMPLATES = Path(__file__).parent / "template"
SCRIPTS = ("theme.js", "abx.js", "listen.js")


def write_page(
    root: Path,
    path: Path,
    *,
    trials: int = 24,
    seed: int = 0,
    objects: Sequence[str] | None = None,
    duration_s: float = 1.0,
) -> None:
    """Draw the sounds of a test from the data set at `root` and write its page, atomically.

    Raises
    ------
    InputError
        See `draw_pairs`.
    """
    pairs = draw_pairs(root, trials, seed, objects=objects, duration_s=duration_s)
    with atomic_write(path) as file:
        file.write(page_text(pairs, seed).encode())


def page_text(pairs: Sequence[Pair], seed: int) -> str:
    """Return the page: equal pairs and seeds give equal bytes."""
    environment = template_environment(TEMPLATES)
    # Within a script element only "<" could end it.
    data = json.dumps(_content(pairs, seed), ensure_ascii=True, allow_nan=False).replace("<", "\\u003c")
    return environment.get_template("listen.html.j2").render(
        policy=security_policy(environment, SCRIPTS),
        data=Markup(data),
        trials=len(pairs),
        objects=len({pair.object_id for pair in pairs}),
        level_rule=LEVEL_RULE,
    )


def _content(pairs: Sequence[Pair], seed: int) -> dict[str, Any]:
    return {
        "software": f"ObjectFolder Factory {objectfolder.__version__}",
        "seed": seed,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "level_rule": LEVEL_RULE,
        "pairs": [
            {
                "object_id": pair.object_id,
                "query": pair.query,
                "level_change_db": round(pair.level_change_db, 3),
                "truth_fingerprint": pair.truth_fingerprint,
                "object_file_fingerprint": pair.file_fingerprint,
                "truth": base64.b64encode(pair.truth.tobytes()).decode(),
                "object_file": base64.b64encode(pair.object_file.tobytes()).decode(),
            }
            for pair in pairs
        ],
    }
