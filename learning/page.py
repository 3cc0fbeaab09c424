"""The results of the tasks on one page, beside the published ones, with examples to look at and to hear."""

import base64
import io
import json
from collections.abc import Iterator
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from PIL import Image
from scipy.io import wavfile

from learning.common_space import both_ways, fit_common_space
from learning.encoders import encoded, object_draws
from learning.grasping.clips import FOLDER, clips_in
from learning.recognition import COMBINATIONS, LETTERS, name_of
from learning.reconstruction import trials
from learning.runs import Objects
from learning.samples import DURATION_S, SAMPLE_RATE_HZ, SENSES
from learning.settings import Settings
from learning.shapes import unit_mesh

PAGE = Path("reports/learning.html")
# ObjectFolder 1.0 (CoRL 2021), tables 3 to 5: its own hundred objects, seen in training, chance .01 and .05.
PUBLISHED_RECOGNITION = dict(
    zip(map(name_of, COMBINATIONS), (94.8, 98.3, 72.4, 99.5, 97.2, 99.0, 99.8), strict=True)
)
PUBLISHED_RETRIEVAL = {
    "V to A": 0.90, "V to T": 0.50, "A to V": 0.92, "A to T": 0.55, "T to V": 0.48, "T to A": 0.64,
}  # fmt: skip
PUBLISHED_SHAPES = {
    "V": (0.8809, 0.0046, 0.9522), "A": (0.8729, 0.0048, 0.9504), "VA": (0.8906, 0.0043, 0.9535),
    "average": (0.0675, 0.1067, 0.6312),
}  # fmt: skip
ROWS, ANSWERS = 3, 5
PICTURE_PIXELS = 96


class Item(NamedTuple):
    """A sample as a reader sees and hears it: data addresses, and whether it is of the object asked for."""

    object_id: str
    picture: str
    sound: str
    right: bool


def write_page(objects: Objects, settings: Settings, results: Path, path: Path = PAGE) -> None:
    """Write the page from the figures of all tasks."""
    # Beside the tasks' figures lie those of Meta-World, which has no settings.
    files = [file for file in results.glob("*.json") if settings_path(file).exists()]
    figures = {file.stem: _json(file) | _json(settings_path(file)) for file in files}
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    text = environment.get_template("page.html.j2").render(
        **figures,
        ids=objects.ids,
        letters=LETTERS,
        published_recognition=PUBLISHED_RECOGNITION,
        published_retrieval=PUBLISHED_RETRIEVAL,
        published_shapes=PUBLISHED_SHAPES,
        rows=list(_retrieved(objects, settings)),
        shapes=list(_shapes(objects, settings)),
        clips=clips_in(path.parent / FOLDER.name),
    )
    path.parent.mkdir(exist_ok=True)
    path.write_text(text, encoding="utf-8")


def settings_path(figures: Path) -> Path:
    """Return the file of settings and objects that figures are of; among figures they would be metrics."""
    return figures.parent / "settings" / figures.name


def _json(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8")))


def _address(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _picture(values: torch.Tensor) -> str:
    """Return a sample's input (channels, h, w) as a PNG; a spectrogram has low frequencies below."""
    pixels = values.clamp(0, 1).permute(1, 2, 0).numpy()
    pixels = pixels[::-1, :, 0] if pixels.shape[2] == 1 else pixels
    image = Image.fromarray((255 * pixels).round().astype(np.uint8))
    buffer = io.BytesIO()
    image.resize((PICTURE_PIXELS, PICTURE_PIXELS)).save(buffer, "PNG", optimize=True)
    return _address("image/png", buffer.getvalue())


def _sound(objects: Objects, object_id: str, point: np.ndarray, impulse: np.ndarray) -> str:
    """Return a strike as a WAV, as loud as it can be."""
    wave = objects.files[object_id].strike(point, impulse, DURATION_S, SAMPLE_RATE_HZ)[0]
    loud = 32000 * wave / max(np.abs(wave).max(), 1e-12)
    buffer = io.BytesIO()
    wavfile.write(buffer, int(SAMPLE_RATE_HZ), loud.astype(np.int16))
    return _address("audio/wav", buffer.getvalue())


def _retrieved(objects: Objects, settings: Settings) -> Iterator[tuple[str, Item, list[Item]]]:
    """Yield queries of the first seed's test with the nearest items of the other sense."""
    seed, count = settings.seeds[0], settings.data.test
    encoders = {sense: encoded(objects, settings, sense, "sample", seed) for sense in SENSES}
    draws = {
        sense: [
            samples["test"] for samples in object_draws(objects, settings, sense, "sample", seed, ("test",))
        ]
        for sense in SENSES
    }

    def item(sense: str, row: int, query_label: int) -> Item:
        label, number = divmod(row, count)
        object_id, samples = objects.ids[label], draws[sense][label]
        sound = ""
        if sense == "audio":
            sound = _sound(objects, object_id, samples.places[number], samples.queries[number])
        return Item(object_id, _picture(samples.inputs[number]), sound, label == query_label)

    for first, second in permutations(SENSES, 2):
        pair = encoders[first], encoders[second]
        training, validation, test = (
            (pair[0].splits[split], pair[1].splits[split]) for split in ("training", "validation", "test")
        )
        space = fit_common_space(training, validation, len(objects), settings.retrieval, seed)
        similarity = both_ways(space, test)[0][0]
        for row in np.random.default_rng(seed).choice(len(similarity), ROWS, replace=False).tolist():
            label = row // count
            nearest = np.argsort(-similarity[row])[:ANSWERS].tolist()
            answers = [item(second, item_row, label) for item_row in nearest]
            yield f"{LETTERS[first]} to {LETTERS[second]}", item(first, row, label), answers


def _shapes(objects: Objects, settings: Settings) -> Iterator[tuple[str, str, str]]:
    """Yield object, its shape and the one predicted from image and sound, as pictures."""
    for trial in trials(objects, settings):
        if len(trial.senses) == 2 and (trial.unseen or trial.seed == settings.seeds[0]):
            for label in trial.shown:
                object_id = objects.ids[label]
                protocol = "unseen" if trial.unseen else "seen"
                predicted = trial.mesh(label)
                picture = "" if predicted is None else _drawn(predicted)
                yield f"{object_id}, {protocol}", _drawn(unit_mesh(objects.files[object_id])), picture


def _drawn(mesh: Any) -> str:
    """Return a mesh as a PNG, seen from above at the side."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(2, 2), dpi=90)
    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d")
    axes.plot_trisurf(*mesh.vertices.T, triangles=mesh.faces, color="#5b8def", linewidth=0)
    axes.set(xlim=(-0.4, 0.4), ylim=(-0.4, 0.4), zlim=(-0.4, 0.4))
    axes.set_box_aspect((1, 1, 1))
    axes.set_axis_off()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", transparent=True)
    pyplot.close(figure)
    return _address("image/png", buffer.getvalue())
