"""`objectfolder fit-sound`, with modes that are stated."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.io import wavfile

from objectfolder.making.materials import read_materials
from objectfolder.making.recordings.body import SolvedBody
from pipeline.cli import main
from pipeline.dataset.project_files import MATERIALS

RATE_HZ = 16000
MODES_HZ = np.array([610.0, 1000.0, 1370.0, 2210.0, 2630.0, 3050.0, 3720.0])
LOSS_FACTOR, FACTOR = 2e-3, 1.03


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """A recording, one that is none, and a mesh that has the modes above."""
    zeros = np.zeros(len(MODES_HZ))
    body = SolvedBody(read_materials(MATERIALS)["glass"], MODES_HZ, zeros, zeros, zeros, 5000.0, 1e-4, 0.003)
    monkeypatch.setattr("objectfolder.making.recordings.body.solve_body", lambda *_, **__: body)
    times = np.arange(RATE_HZ // 2) / RATE_HZ
    ringing = np.sum(
        [np.exp(-np.pi * LOSS_FACTOR * f * times) * np.sin(2 * np.pi * f * times) for f in FACTOR * MODES_HZ],
        axis=0,
    )
    samples = np.concatenate([np.zeros(RATE_HZ // 10), ringing])
    samples += 1e-4 * np.random.default_rng(0).normal(size=len(samples))
    wavfile.write(tmp_path / "strike.wav", RATE_HZ, samples / 10)
    wavfile.write(tmp_path / "silence.wav", RATE_HZ, np.zeros(RATE_HZ))
    trimesh.creation.box((0.1, 0.05, 0.02)).export(tmp_path / "block.obj")
    return [str(tmp_path / name) for name in ("strike.wav", "silence.wav", "block.obj")]


def test_a_fit_is_printed_and_written_and_names_the_recording_that_is_left_out(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = tmp_path / "block.csv"
    assert main(["fit-sound", *files, "--material", "glass", "--mass", "0.26", "-o", str(row)]) == 0
    printed = capsys.readouterr().out
    assert "7 of 7 partials matched: 51.2 cents rms before, 0.0 after" in printed
    assert "silence.wav: 1.000 s, peak 0: no strike" in printed
    assert "not visible in these partials" in printed
    material = read_materials(row)["block"]
    assert material.density_kg_m3 == pytest.approx(2600)
    assert material.youngs_modulus_pa == pytest.approx(6.2e10 * FACTOR**2, rel=1e-3)
    assert "fitted to 1 recordings of a strike (strike.wav) and block.obj: 7 partials" in material.citation
    assert material.loss_factor == pytest.approx(LOSS_FACTOR, rel=0.03)
    assert material.loss_exponent == pytest.approx(0, abs=0.03)
    assert material.friction == read_materials(MATERIALS)["glass"].friction


def test_a_fit_as_json_has_each_mode_s_decay(files: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fit-sound", files[0], files[2], "--material", "glass", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    decays = [row["decay_per_s"] for row in result["matched"]]
    np.testing.assert_allclose(decays, np.pi * LOSS_FACTOR * FACTOR * MODES_HZ, rtol=0.02)


def test_a_recording_alone_and_a_material_that_is_not_given_are_refused(
    files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit-sound", files[0], "--material", "glass"]) == 1
    assert main(["fit-sound", files[0], files[2]]) == 2
    assert main(["fit-sound", files[1], files[2], "--material", "glass"]) == 1
    errors = capsys.readouterr().err
    assert "fit-sound: 1 file given. Give recordings, then the mesh." in errors
    assert "--material: not given. Begin from one of ceramic" in errors
    assert "recordings: left out:" in errors
