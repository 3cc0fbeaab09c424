"""Who may ask the live page, and what it answers without a browser."""

import contextlib
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil
import pytest

import objectfolder
from objectfolder.errors import InputError
from pipeline.cli import main
from pipeline.publish.viewer import live
from pipeline.publish.viewer.live import Query, Server, page_of_objects
from pipeline.publish.viewer.live_queries import LiveObjects
from tests.viewer.live_servers import served, served_page

JSON = {"Content-Type": "application/json"}
DOWN = {"origin": [0, 0, 1], "direction": [0, 0, -1]}


@pytest.fixture(scope="module")
def server(small_file):
    with served(small_file) as running:
        yield running


def asked(server, method, path, body=None, headers=None, host=None):
    """Status, headers and body of a request."""
    port = urlsplit(server.address).port
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
        header_fields = {"Host": host or f"127.0.0.1:{port}", **(headers or {})}
        connection.request(method, path, body, header_fields)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()


def query(server, path, question):
    status, _, body = asked(server, "POST", path, json.dumps(question), JSON)
    assert status == 200, body
    length = int.from_bytes(body[:4], "little")
    return json.loads(body[4 : 4 + length]), body[4 + length :]


def test_bounded_threads_leave_numbas_variables_alone(monkeypatch):
    """Numba reads them again where one changed, and compiles for another target than that of the cache."""
    variables: dict[str, str] = {}
    monkeypatch.setattr(live.os, "environ", variables)
    monkeypatch.setattr(live, "threadpool_limits", lambda _: None)
    live.one_thread_each()
    assert "OMP_NUM_THREADS" in variables
    assert not [name for name in variables if name.startswith("NUMBA_")]


def test_it_listens_on_loopback_alone(server):
    port = urlsplit(server.address).port
    listening = [
        connection.laddr.ip
        for connection in psutil.Process().net_connections(kind="inet")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
    ]
    assert listening == ["127.0.0.1"]


def test_the_page_takes_nothing_from_elsewhere(server):
    status, headers, body = asked(server, "GET", "/")
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for name in re.findall(rb'(?:src|href)="([^"]+)"', body):
        if name != b"data:,":
            assert asked(server, "GET", f"/{name.decode()}")[0] == 200, name


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "127.0.0.1:1", "[::1]:80"])
def test_other_names_of_this_host_are_refused(server, host):
    for method, path in (("GET", "/"), ("POST", "/object"), ("GET", "/no")):
        status, _, body = asked(server, method, path, "{}" if method == "POST" else None, JSON, host)
        assert status == 403, (method, path)
        assert b"Glass bar" not in body


def test_its_own_names_are_answered(server):
    port = urlsplit(server.address).port
    for host in (f"127.0.0.1:{port}", f"localhost:{port}"):
        assert asked(server, "POST", "/object", "{}", JSON, host)[0] == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_other_pages_are_refused(server, headers):
    status, answer_headers, body = asked(server, "POST", "/object", "{}", JSON | headers)
    assert (status, b"Glass bar" in body) == (403, False)
    assert "Access-Control-Allow-Origin" not in answer_headers


def test_forms_of_other_pages_are_refused(server):
    """What a form can send without being asked first has another type."""
    assert asked(server, "POST", "/object", "{}", {"Content-Type": "text/plain"})[0] == 415


@pytest.mark.parametrize(
    "path",
    [
        "/../live.py",
        "/..%2flive.py",
        "/%2e%2e/live.py",
        "//etc/passwd",
        "/page/live.html",
        "/live.html",
        "/.",
        "/x\\y",
    ],
)
def test_no_path_leads_to_a_file(server, path):
    status, _, body = asked(server, "GET", path)
    assert status == 404
    assert b"import" not in body


def test_an_image_is_the_packages(server, small_file):
    file = objectfolder.load(small_file)
    camera, light = file.sample_views(1, seed=3)
    view = {"camera_to_world": camera[0].tolist(), "light_position": light[0].tolist()}
    for sub_rays in (None, 4):
        header, body = query(server, "/render", {**view, "resolution": 48, "sub_rays": sub_rays})
        expected = file.render(camera[0], light[0], 48, sub_rays=sub_rays)[0]
        assert header == {"resolution": 48}
        assert np.array_equal(np.frombuffer(body, np.uint8).reshape(48, 48, 3), expected)
        _, part = query(server, "/render", {**view, "resolution": 48, "sub_rays": sub_rays, "rows": [16, 8]})
        assert part == body[16 * 48 * 3 : 24 * 48 * 3]
    assert expected.min() < 200


def test_a_blow_and_a_press_are_the_packages(server, small_file):
    file = objectfolder.load(small_file)
    ray = {"origin": [0.01, 0.003, 0.5], "direction": [0, 0, -1]}
    header, body = query(
        server, "/strike", {**ray, "impulse": 0.05, "along": None, "duration": 0.5, "sample_rate": 48000}
    )
    assert header["point"] == pytest.approx([0.01, 0.003, 0.004], abs=2e-6)
    assert header["normal"] == pytest.approx([0, 0, 1], abs=1e-6)
    assert header["impulse"] == pytest.approx([0, 0, -0.05], abs=1e-6)
    expected = file.strike(np.array(header["point"]), np.array(header["impulse"]), 0.5, 48000)[0]
    assert np.abs(expected).max() > 0
    assert np.array_equal(np.frombuffer(body, "<f4"), expected)
    partials, _ = query(server, "/partials", {name: header[name] for name in ("point", "impulse")})
    velocities = file.mode_velocities(header["point"], header["impulse"])[0]
    assert np.allclose(partials["amplitudes"], velocities, rtol=1e-9)
    assert np.allclose(sum(partials["amplitudes"]), expected[0], rtol=1e-5)  # they make the first sample
    header, body = query(server, "/press", {**ray, "depth": 0.001, "tilt": 4, "azimuth": 30})
    touch = file.press(np.array(header["point"]), 0.001, 4, 30)
    pixels = touch.rgb[0].size
    assert header["reachable"]
    assert np.array_equal(np.frombuffer(body[:pixels], np.uint8), touch.rgb[0].ravel())
    assert np.array_equal(np.frombuffer(body[pixels:], "<f4"), touch.depth_m[0].ravel())


def test_a_ray_past_the_object_meets_nothing(server):
    ray = {"origin": [1, 1, 1], "direction": [0, 0, -1], "depth": 0.001, "tilt": 0, "azimuth": 0}
    assert query(server, "/press", ray) == ({"missed": True}, b"")


@pytest.mark.parametrize(
    ("path", "question", "named"),
    [
        ("/render", {}, "resolution"),
        ("/render", {"resolution": 1e9}, "resolution"),
        ("/render", {"resolution": 16, "camera_to_world": [[1]]}, "camera_to_world"),
        ("/render", {"resolution": 16, "camera_to_world": np.eye(4).tolist(), "studio": "attic"}, "attic"),
        ("/strike", {"impulse": "much"}, "impulse"),
        ("/strike", {"impulse": 1, "duration": 1e6}, "duration"),
        ("/strike", {"impulse": 1, "duration": 1, "sample_rate": 1}, "sample_rate"),
        ("/strike", DOWN | {"impulse": 1, "along": [0, 0, 0], "duration": 1, "sample_rate": 44100}, "along"),
        ("/press", {"depth": None}, "depth"),
        ("/press", DOWN | {"depth": 1, "tilt": 0, "azimuth": 0}, "depth"),
        ("/press", DOWN | {"depth": 0, "tilt": 0, "azimuth": 0, "direction": [0, 0, 0]}, "direction"),
        ("/object", [], "JSON"),
    ],
)
def test_questions_without_an_answer_say_why(server, path, question, named):
    status, _, body = asked(server, "POST", path, json.dumps(question), JSON)
    assert status == 400
    assert named in json.loads(body)["error"]


def test_deep_json_is_refused(server):
    for deep in (b"[" * 20_000, b'{"a":' * 8_000):
        assert asked(server, "POST", "/render", deep, JSON)[0] == 400
    assert asked(server, "GET", "/")[0] == 200


def test_long_requests_are_refused(server):
    with contextlib.suppress(ConnectionError):
        assert asked(server, "POST", "/render", b" " * (1 << 20), JSON)[0] in (400, 413)
    assert asked(server, "GET", "/")[0] == 200


def test_a_taken_port_is_named(small_file):
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        with pytest.raises(InputError, match=f"--port: {port}"):
            Server(page_of_objects(LiveObjects([small_file])), port)


def test_an_object_that_is_not_there_and_a_folder_without_any_are_named(server, tmp_path, capsys):
    for number, finding in (("7", "there is no 7"), ("-1", "there is no -1"), ("mug", "mug")):
        status, _, body = asked(server, "POST", f"/object?object={number}", b"{}", JSON)
        assert status == 400
        assert finding in json.loads(body)["error"]
    assert main(["view", str(tmp_path), "--no-browser"]) == 1
    assert f"{tmp_path}: no Object File" in capsys.readouterr().err


@pytest.mark.usefixtures("quiet")
def test_what_is_no_object_file_is_an_error_of_one_line(tmp_path, small_file, capsys):
    (tmp_path / "note.safetensors").write_text("a note")
    damaged = bytearray(small_file.read_bytes())
    damaged[len(damaged) // 2] ^= 8
    (tmp_path / "damaged.safetensors").write_bytes(damaged)
    for name, finding in (
        ("note", "not a safetensors file"),
        ("damaged", "does not match its digest"),
        ("absent", "no such file"),
    ):
        path = tmp_path / f"{name}.safetensors"
        assert main(["view", str(path), "--no-browser"]) == 1
        said = capsys.readouterr().err
        assert str(path) in said
        assert finding in said
        assert said.count("\n") == 1


MAIN = "import sys; from pipeline.cli import main; sys.exit(main())"
# What is compiled or computed when the interrupt comes may take minutes more: here it never ends.
WORKING = r"""
import os, threading
from pipeline.publish.viewer.live_queries import LiveObject
work = lambda _: (os.write(1, b"at work\n"), threading.Event().wait())
LiveObject.warm_images = LiveObject.warm_contacts = work
"""


def test_a_token_is_asked_for_where_the_address_has_one(small_file):
    with served(small_file, token="3xyz") as server:
        assert server.address.endswith("/?token=3xyz")
        assert asked(server, "GET", "/?token=3xyz")[0] == 200
        for path in ("/object", "/object?token=", "/object?token=3xy", "/object?token=%C3%A9"):
            status, _, body = asked(server, "POST", path, "{}", JSON)
            assert (status, b"Glass bar" in body) == (403, False)
        assert asked(server, "POST", "/object?token=3xyz", "{}", JSON)[0] == 200


def test_a_question_that_nobody_waits_for_is_dropped(small_file, monkeypatch):
    entered, leave, closed, answered = threading.Event(), threading.Event(), threading.Event(), []
    drop = Query.on_connection_close
    monkeypatch.setattr(Query, "on_connection_close", lambda self: (drop(self), closed.set()))

    def answer(number, question):
        answered.append(question["number"])
        entered.set()
        assert leave.wait(60)
        return {}, b""

    questions = {"wait": (answer, ThreadPoolExecutor(1))}
    page = replace(page_of_objects(LiveObjects([small_file])), warm=(), questions=questions)
    with served_page(page) as server, contextlib.ExitStack() as left:
        port = urlsplit(server.address).port
        asking = [http.client.HTTPConnection("127.0.0.1", port, timeout=60) for _ in range(3)]
        for number, connection in enumerate(asking):
            left.callback(connection.close)
            connection.request("POST", "/wait", json.dumps({"number": number}), JSON)
            assert entered.wait(60)
        asking[1].close()
        assert closed.wait(60)
        leave.set()
        assert asking[2].getresponse().status == 200
    assert answered == [0, 2]


@pytest.mark.parametrize("before", ["", WORKING], ids=["idle", "at work"])
def test_the_command_prints_its_address_and_ends_on_interrupt(small_file, before):
    process = subprocess.Popen(
        [sys.executable, "-c", before + MAIN, "view", str(small_file), "--no-browser"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    line = process.stdout.readline()
    assert re.search(r"http://127\.0\.0\.1:\d+/\?token=\S{22} ", line)
    if before:
        assert process.stdout.readline() == "at work\n"
    process.send_signal(signal.SIGINT)
    try:
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert (process.returncode, errors) == (0, "")
