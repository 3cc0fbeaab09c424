"""AudioNet against the modes it was fitted to, at points it has not seen."""

import numpy as np
import pytest
from structured_solids import box, material

from objectfolder.audio.audionet import AudioNet, fit_audionet
from objectfolder.audio.modes import modes_of_solid
from objectfolder.errors import FormatError
from objectfolder.geometry.surface import Surface
from objectfolder.store import Product


@pytest.fixture(scope="module")
def plate() -> tuple[Surface, Product]:
    """A plate of 4 mm: two sides nearer to one another than control points are."""
    solid = box((6, 5, 1), (0.1, 0.08, 0.004))
    surface = Surface(solid.vertices, solid.boundary()[0])
    modes = modes_of_solid(
        surface,
        solid,
        material(),
        max_frequency_hz=20000.0,
        max_modes=20,
        training_points=800,
        held_out_points=150,
        seed=0,
        order=2,
    )
    return surface, modes


@pytest.fixture(scope="module")
def net(plate: tuple[Surface, Product]) -> AudioNet:
    return fit_audionet(*plate)


def test_unseen_points_are_met_within_minus_26_db(plate: tuple[Surface, Product], net: AudioNet) -> None:
    _, modes = plate
    held_out = modes["held_out"]
    truth = modes["mode_shapes"][held_out].astype(float)
    error = net.gains(modes["points"][held_out]) - truth
    assert 20 * np.log10(np.linalg.norm(error) / np.linalg.norm(truth)) < -26
    assert sum(tensor.nbytes for tensor in net.tensors().values()) < 400_000


def test_frequencies_and_dampings_are_the_solvers(plate: tuple[Surface, Product], net: AudioNet) -> None:
    for name in ("frequencies_hz", "dampings_per_s", "radiation_weights"):
        np.testing.assert_array_equal(getattr(net, name), plate[1][name])


def test_held_out_points_are_not_read(plate: tuple[Surface, Product], net: AudioNet) -> None:
    surface, modes = plate
    spoiled = modes["mode_shapes"].copy()
    spoiled[modes["held_out"]] = np.nan
    arrays = dict(modes.arrays)
    arrays["mode_shapes"] = type(arrays["mode_shapes"])(
        spoiled, ("point", "axis", "mode"), "kg-1/2", "mode shapes"
    )
    again = fit_audionet(surface, Product(arrays, modes.attributes))
    for name, tensor in net.tensors().items():
        np.testing.assert_array_equal(again.tensors()[name], tensor)


def test_batches_answer_as_single_points_do(plate: tuple[Surface, Product], net: AudioNet) -> None:
    points = plate[1]["points"][:7]
    together = net.gains(points)
    for index, point in enumerate(points):
        np.testing.assert_array_equal(net.gains(point[None])[0], together[index])


def test_what_is_stored_answers_alike_and_damage_is_named(
    plate: tuple[Surface, Product], net: AudioNet
) -> None:
    surface, modes = plate
    tensors, metadata = net.tensors(), net.metadata()
    again = AudioNet.from_tensors(tensors, metadata, surface)
    np.testing.assert_array_equal(again.gains(modes["points"][:3]), net.gains(modes["points"][:3]))
    with pytest.raises(FormatError, match=r"audio\.scales"):
        AudioNet.from_tensors({k: v for k, v in tensors.items() if k != "audio.scales"}, metadata, surface)
    with pytest.raises(FormatError, match=r"audio\.control_gains"):
        AudioNet.from_tensors(
            {**tensors, "audio.control_gains": tensors["audio.control_gains"][:-1]}, metadata, surface
        )
    with pytest.raises(FormatError, match="metadata"):
        AudioNet.from_tensors(tensors, {}, surface)


def test_more_bytes_buy_a_smaller_error(plate: tuple[Surface, Product]) -> None:
    surface, modes = plate
    held_out = modes["held_out"]
    truth = modes["mode_shapes"][held_out].astype(float)
    errors = []
    for most_bytes in (1_500, 3_000, 6_000):
        net = fit_audionet(surface, modes, goal_db=-90, most_bytes=most_bytes)
        assert net.tensors()["audio.control_gains"].nbytes <= most_bytes
        errors.append(float(np.linalg.norm(net.gains(modes["points"][held_out]) - truth)))
    assert errors[0] > errors[1] > errors[2]


def test_an_object_without_modes_has_gains_of_no_mode(plate: tuple[Surface, Product]) -> None:
    surface, modes = plate
    none = {
        name: type(array)(array.data[..., :0], array.dims, array.units, array.long_name)
        if "mode" in array.dims
        else array
        for name, array in modes.arrays.items()
    }
    silent = fit_audionet(surface, Product(none, modes.attributes))
    assert silent.gains(modes["points"][:2]).shape == (2, 3, 0)
    again = AudioNet.from_tensors(silent.tensors(), silent.metadata(), surface)
    assert len(again.frequencies_hz) == 0
