"""The demo: the package's Object Files on a wooden table, played in the browser."""

from pathlib import Path
from tempfile import TemporaryDirectory

from objectfolder import EXAMPLES
from pipeline.publish.export.assets import compose_scene
from pipeline.publish.queries.requests import Exporting
from pipeline.publish.viewer.play import play_in_browser

SEED = 0  # of turns and places: nothing hides anything from the first camera


def write_demo(folder: Path) -> Path:
    """Write the scene of all examples into a folder; return its path."""
    names = [str(path) for path in sorted(EXAMPLES.glob("*.safetensors"))]
    scene = folder / "scene.xml"
    request = Exporting(format="mjcf", seed=SEED)
    compose_scene(names, folder, request, scene, table_m=None, height_m=0.0, upright=True, looks=False)
    return scene


def play_demo(port: int, open_browser: bool) -> None:
    """Play the examples in the browser until Ctrl-C; raises as `play_in_browser`."""
    with TemporaryDirectory() as folder:
        play_in_browser(write_demo(Path(folder)), port, open_browser)
