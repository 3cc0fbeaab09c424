"""AudioNet against the modes it was fitted to, at points it has not seen."""

import numpy as np
import pytest
import trimesh
from rounding import assert_equal_but_for_rounding
from small_meshes import box

from objectfolder.audio.audionet.audionet import AudioNet, decode_detours, encode_detours
from objectfolder.errors import FormatError
from objectfolder.making.audionet import fitting
from objectfolder.making.audionet.fitting import fit_audionet
from objectfolder.making.audionet.geodesic_embedding import subdivide
from objectfolder.products.integer_coding import pack_integers, zigzag
from objectfolder.products.store import Array, Product
from objectfolder.surface.surface import Surface

MODE_ARRAYS = ("eigenvalues", "dampings_per_s", "radiation_weights")


def error_db(net: AudioNet, modes: Product) -> float:
    """Gain error at held-out points."""
    held_out = modes["held_out"]
    truth = modes["mode_shapes"][held_out].astype(float)
    error = net.gains(modes["points"][held_out]) - truth
    return float(20 * np.log10(np.linalg.norm(error) / np.linalg.norm(truth)))


def stored_bytes(net: AudioNet) -> int:
    return sum(tensor.nbytes for tensor in net.tensors().values())


@pytest.fixture(scope="module")
def plate() -> tuple[Surface, Product]:
    """A plate of 4 mm, bending as Kirchhoff's does: its two sides are nearer than control points are.

    u = (-z dw/dx, -z dw/dy, w) with standing waves w.
    """
    a, b, thickness = 0.1, 0.08, 0.004
    surface = Surface(*box((0, 0, 0), (a, b, thickness)))
    points = np.concatenate([surface.sample(2000, 0).points, surface.sample(200, 1).points])
    x, y, z = points.T
    shapes = []
    for m, n in [(m, n) for m in range(6) for n in range(5) if m + n > 1][:20]:
        p, q = m * np.pi / a, n * np.pi / b
        turn_x = p * np.sin(p * x) * np.cos(q * y)
        turn_y = q * np.cos(p * x) * np.sin(q * y)
        arm = z - thickness / 2
        shapes.append(np.stack([arm * turn_x, arm * turn_y, np.cos(p * x) * np.cos(q * y)], axis=1))
    return surface, product(points, np.stack(shapes, axis=2), np.arange(2200) >= 2000)


@pytest.fixture(scope="module")
def net(plate: tuple[Surface, Product]) -> AudioNet:
    return fit_audionet(*plate)


def comb() -> Surface:
    """A spine with three teeth of 10 mm, 2 mm apart, one closed surface."""
    parts = [((0.0, -0.02, 0.0), (0.034, 0.0, 0.006))]
    parts += [((x, -0.01, 0.0), (x + 0.01, 0.08, 0.006)) for x in (0.0, 0.012, 0.024)]
    whole = trimesh.boolean.union(
        [trimesh.creation.box(bounds=bounds) for bounds in parts], engine="manifold"
    )
    return Surface(np.array(whole.vertices), np.array(whole.faces))


def product(points: np.ndarray, shapes: np.ndarray, held_out: np.ndarray) -> Product:
    """Modes as a solver would give them, of given shapes (point, 3, mode)."""
    count = shapes.shape[2]
    eigenvalues = (2 * np.pi * 500.0 * np.arange(1, count + 1)) ** 2
    each = {
        "eigenvalues": eigenvalues,
        "dampings_per_s": 3 + 5e-8 * eigenvalues,
        "radiation_weights": np.ones(count),
    }
    arrays = {name: Array(values, ("mode",), "1", name) for name, values in each.items()}
    arrays["points"] = Array(points, ("point", "axis"), "m", "points")
    arrays["mode_shapes"] = Array(shapes.astype(np.float32), ("point", "axis", "mode"), "kg-1/2", "shapes")
    arrays["held_out"] = Array(held_out, ("point",), "1", "held out")
    return Product(arrays, {"stated_frequency_limit_hz": 20000.0})


def test_unseen_points_are_met_within_minus_40_db(plate: tuple[Surface, Product], net: AudioNet) -> None:
    assert error_db(net, plate[1]) < -40
    assert stored_bytes(net) < 30_000


@pytest.mark.slow
def test_teeth_that_move_apart_are_told_apart() -> None:
    """Bending of each tooth by itself: across a gap of 2 mm displacements have nothing in common."""
    surface = comb()
    samples = [surface.sample(count, seed) for count, seed in ((3000, 1), (300, 2))]
    points = np.concatenate([sample.points for sample in samples])
    tooth = np.clip(np.floor((points[:, 0] + 0.001) / 0.012), 0, 2).astype(int)
    height = np.maximum(points[:, 1], 0.0) / 0.08
    shapes = np.zeros((len(points), 3, 6))
    for mode in range(6):
        swing = height**2 * (1 - (mode // 3) * 1.3 * height) * (tooth == mode % 3)
        shapes[:, 2, mode] = swing
        shapes[:, 1, mode] = -(points[:, 2] - 0.003) * 20 * height * (tooth == mode % 3)
    modes = product(points, shapes, np.arange(len(points)) >= 3000)
    net = fit_audionet(surface, modes)
    assert net.metadata()["detour_dimensions"] >= 1
    assert error_db(net, modes) < -40
    assert stored_bytes(net) < 40_000


@pytest.mark.slow
def test_a_tongue_that_moves_by_itself_is_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A patch of a torn wall: at its edge the modes jump within the width of a face."""
    plain = Surface(*box((0, 0, 0), (0.1, 0.08, 0.01)))
    surface = Surface(*subdivide(plain.vertices, plain.faces, 0.006, 4000))
    samples = [surface.sample(count, seed) for count, seed in ((6000, 2), (400, 3))]
    points = np.concatenate([sample.points for sample in samples])
    tongue = (np.abs(surface.vertices - [0.05, 0.04, 0.01]) < [0.015, 0.011, 0.001]).all(axis=1)
    moves = np.multiply.outer(tongue * 1.0, np.random.default_rng(4).normal(0, 1, (3, 6)))
    shapes = np.concatenate(
        [np.einsum("nc,nckm->nkm", at.barycentric, moves[surface.faces[at.face]]) for at in samples]
    )
    shapes += np.cos(np.multiply.outer(points, np.arange(6) * np.pi / 0.1))
    modes = product(points, shapes, np.arange(len(points)) >= 6000)
    monkeypatch.setattr(fitting, "CONTROL_POINTS", (60, 120, 240))
    corrected = fit_audionet(surface, modes)
    assert 0 < corrected.metadata()["corrections"] < len(surface.vertices)
    monkeypatch.setattr(fitting, "MOST_CORRECTED", 0)
    smooth = fit_audionet(surface, modes)
    assert smooth.metadata()["corrections"] == 0
    assert error_db(corrected, modes) < -40 < -30 < error_db(smooth, modes)
    again = AudioNet.from_tensors(corrected.tensors(), corrected.metadata(), surface)
    np.testing.assert_array_equal(again.gains(points[:20]), corrected.gains(points[:20]))
    for wrong in ({"corrections": 1}, {"corrections": -1}, {"corrections": 10**9}):
        with pytest.raises(FormatError, match="audio"):
            AudioNet.from_tensors(corrected.tensors(), {**corrected.metadata(), **wrong}, surface)
    beyond = pack_integers(
        zigzag(np.full(corrected.metadata()["corrections"], len(surface.vertices), dtype=np.int64))
    )
    with pytest.raises(FormatError, match="vertices that are not there"):
        AudioNet.from_tensors(
            {**corrected.tensors(), "audio.corrected": beyond}, corrected.metadata(), surface
        )


def test_eigenvalues_and_dampings_are_the_solvers(plate: tuple[Surface, Product], net: AudioNet) -> None:
    for name in MODE_ARRAYS:
        np.testing.assert_array_equal(getattr(net, name), plate[1][name])
    angular = np.sqrt(plate[1]["eigenvalues"] - plate[1]["dampings_per_s"] ** 2)
    np.testing.assert_allclose(net.frequencies_hz, angular / (2 * np.pi), rtol=1e-12)


def test_modes_beyond_critical_damping_are_kept_and_have_no_frequency(plate: tuple[Surface, Product]) -> None:
    surface, modes = plate
    arrays = dict(modes.arrays)
    damping = arrays["dampings_per_s"]
    beyond = 2 * np.sqrt(modes["eigenvalues"])
    arrays["dampings_per_s"] = Array(beyond, damping.dims, damping.units, damping.long_name)
    net = fit_audionet(surface, Product(arrays, modes.attributes), goal_db=-20)
    assert len(net.eigenvalues) == len(modes["eigenvalues"])
    np.testing.assert_array_equal(net.frequencies_hz, 0.0)


def test_held_out_points_are_not_read(plate: tuple[Surface, Product], net: AudioNet) -> None:
    surface, modes = plate
    spoiled = modes["mode_shapes"].copy()
    spoiled[modes["held_out"]] = np.nan
    arrays = dict(modes.arrays)
    arrays["mode_shapes"] = Array(spoiled, ("point", "axis", "mode"), "kg-1/2", "mode shapes")
    again = fit_audionet(surface, Product(arrays, modes.attributes))
    for name, tensor in net.tensors().items():
        np.testing.assert_array_equal(again.tensors()[name], tensor)


def test_batches_answer_as_single_points_do(plate: tuple[Surface, Product], net: AudioNet) -> None:
    points = plate[1]["points"][:37]
    together = net.gains(points)
    for index, point in enumerate(points):
        assert_equal_but_for_rounding(net.gains(point[None])[0], together[index])


def test_a_point_on_an_edge_or_vertex_has_one_answer(plate: tuple[Surface, Product], net: AudioNet) -> None:
    """Whichever of the faces around it a point falls to, creases included: approach it within each."""
    surface, _ = plate
    scale = np.sqrt(np.mean(net.gains(plate[1]["points"][:200]) ** 2))
    corner = int(np.flatnonzero((surface.vertices == surface.bounds[0]).all(axis=1))[0])
    for place, faces in (
        (surface.vertices[corner], np.flatnonzero((surface.faces == corner).any(axis=1))),
        (surface.vertices[surface.faces[0, :2]].mean(axis=0), _faces_of_edge(surface, surface.faces[0, :2])),
    ):
        answer = net.gains(place)
        assert np.isfinite(answer).all()
        for face in faces:
            within = place + 1e-9 * (surface.vertices[surface.faces[face]].mean(axis=0) - place)
            assert np.abs(net.gains(within) - answer).max() < 1e-5 * scale


def _faces_of_edge(surface: Surface, edge: np.ndarray) -> np.ndarray:
    return np.flatnonzero(np.isin(surface.faces, edge).sum(axis=1) == 2)


def test_points_off_the_surface_are_answered_at_the_nearest_point(
    plate: tuple[Surface, Product], net: AudioNet
) -> None:
    surface, _ = plate
    sample = surface.sample(20, 9)
    lifted = sample.points + 1e-4 * surface.face_normals[sample.face]
    scale = np.abs(net.gains(sample.points)).max()
    np.testing.assert_allclose(net.gains(lifted), net.gains(sample.points), atol=1e-6 * scale)


def test_what_is_stored_answers_alike_and_damage_is_named(
    plate: tuple[Surface, Product], net: AudioNet
) -> None:
    surface, modes = plate
    tensors, metadata = net.tensors(), net.metadata()
    again = AudioNet.from_tensors(tensors, metadata, surface)
    np.testing.assert_array_equal(again.gains(modes["points"][:3]), net.gains(modes["points"][:3]))
    for name in tensors:
        with pytest.raises(FormatError, match=name.replace(".", r"\.")):
            AudioNet.from_tensors({k: v for k, v in tensors.items() if k != name}, metadata, surface)
        with pytest.raises(FormatError):
            AudioNet.from_tensors({**tensors, name: tensors[name][:-1]}, metadata, surface)
        with pytest.raises(FormatError):
            AudioNet.from_tensors({**tensors, name: tensors[name].astype(np.float32)}, metadata, surface)
    wrong = {
        "audio.control_faces": np.full_like(tensors["audio.control_faces"], len(surface.faces)),
        "audio.control_barycentric": np.full_like(tensors["audio.control_barycentric"], 200),
        "audio.step": np.array([np.nan]),
        "audio.eigenvalues": -tensors["audio.eigenvalues"],
        "audio.coefficients": tensors["audio.coefficients"][::-1].copy(),
    }
    for name, tensor in wrong.items():
        with pytest.raises(FormatError):
            AudioNet.from_tensors({**tensors, name: tensor}, metadata, surface)
    for changed in (
        {},
        {**metadata, "kernel": {**metadata["kernel"], "length": -1}},
        {**metadata, "kernel": {"width": 1}},
        {**metadata, "modes": "many"},
        {**metadata, "damping": {"law": "viscous"}},
        {**metadata, "damping": {"law": "loss_factor", "loss_factor": "much"}},
    ):
        with pytest.raises(FormatError, match="audio"):
            AudioNet.from_tensors(tensors, changed, surface)
    # A file of before there were laws states none.
    older = {name: value for name, value in metadata.items() if name != "damping"}
    assert AudioNet.from_tensors(tensors, older, surface).damping == {"law": "rayleigh"}
    stated = {"law": "loss_factor", "loss_factor": 1e-3, "loss_exponent": 0.0}
    assert AudioNet.from_tensors(tensors, metadata | {"damping": stated}, surface).damping == stated
    omega = np.sqrt(net.eigenvalues)
    np.testing.assert_allclose(net.loss_factors, (3 / omega + 5e-8 * omega) * 2, rtol=1e-12)


@pytest.mark.slow
def test_bytes_are_bounded_and_more_of_them_buy_a_smaller_error(
    plate: tuple[Surface, Product], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fitting, "CONTROL_POINTS", (60, 120, 240))
    surface, modes = plate
    errors = []
    for most_bytes in (5_000, 10_000):
        net = fit_audionet(surface, modes, goal_db=-60, most_bytes=most_bytes)
        assert stored_bytes(net) <= most_bytes
        errors.append(error_db(net, modes))
    assert errors[0] > errors[1] + 6
    with pytest.raises(ValueError, match="too few"):
        fit_audionet(surface, modes, most_bytes=800)


def test_a_looser_goal_takes_fewer_bytes(plate: tuple[Surface, Product], net: AudioNet) -> None:
    surface, modes = plate
    loose = fit_audionet(surface, modes, goal_db=-26)
    assert -32 < error_db(loose, modes) < -24
    assert stored_bytes(loose) < 0.6 * stored_bytes(net)


def test_an_object_without_modes_has_gains_of_no_mode(plate: tuple[Surface, Product]) -> None:
    surface, modes = plate
    none = {
        name: Array(array.data[..., :0], array.dims, array.units, array.long_name)
        if "mode" in array.dims
        else array
        for name, array in modes.arrays.items()
    }
    silent = fit_audionet(surface, Product(none, modes.attributes))
    assert silent.gains(modes["points"][:2]).shape == (2, 3, 0)
    again = AudioNet.from_tensors(silent.tensors(), silent.metadata(), surface)
    assert len(again.frequencies_hz) == 0


def test_detours_come_back_within_half_a_step() -> None:
    detours = np.cumsum(np.random.default_rng(0).normal(0, 1e-3, (500, 3)), axis=0)
    back = decode_detours(encode_detours(detours, 0.2), 500, 3, 0.2)
    assert np.abs(back - detours).max() <= 0.2 * 2.0**-14 * (1 + 1e-9)
    with pytest.raises(FormatError, match="detours"):
        decode_detours(encode_detours(detours, 0.2), 500, 2, 0.2)
