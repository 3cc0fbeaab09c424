"""The listening test: right sounds at one level, a fair plan, and the score that the answers deserve."""

import base64
import json
import random
import re

import numpy as np
import pytest
from axe_playwright_python.sync_playwright import Axe
from scipy.stats import binomtest

from docs.listening.page import PEAK, Pair, draw_pairs, main, match, page_text
from objectfolder.dataset import ObjectFolderDataset
from objectfolder.errors import InputError
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ

pytest_plugins = ["tests.browser"]

TRIALS, SEED = 12, 5
# What is played, as the page hands it to the sound card.
LISTEN = """
window.heard = [];
const copy = AudioBuffer.prototype.copyToChannel;
AudioBuffer.prototype.copyToChannel = function (values, ...rest) {
  const levels = Array.from(values, (value) => Math.round(value * 32768));
  window.heard.push({ rate: this.sampleRate, values: levels });
  return copy.call(this, values, ...rest);
};
"""


def tone(frequency, level, decay=8.0):
    time = np.arange(4410) / SAMPLE_RATE_HZ
    return level * np.exp(-decay * time) * np.sin(2 * np.pi * frequency * time)


@pytest.fixture(scope="module")
def pairs():
    """Pairs that a script can tell apart, with levels as the stimuli have them."""
    stimuli = []
    for index in range(TRIALS):
        truth, answer, change = match(tone(400 + 30 * index, 1e-3), tone(401 + 30 * index, 3.0))
        stimuli.append(Pair(f"object-{index % 3}", index, truth, answer, change, "t" * 64, "f" * 64))
    return stimuli


@pytest.fixture(scope="module")
def page_file(pairs, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "listen.html"
    path.write_text(page_text(pairs, SEED), encoding="utf-8")
    return path


@pytest.fixture
def started(open_page, page_file):
    def start(seed=None, **settings):
        watched = open_page(page_file, init_script=LISTEN, **settings)
        if seed is not None:
            watched.page.fill("#seed", str(seed))
        watched.page.fill("#participant", "Ada <b>")
        watched.page.click("text=Begin")
        return watched

    return start


def hear(page, letter):
    page.click(f"#play-{letter}")
    return page.evaluate("window.heard.at(-1)")


def saved(page):
    with page.expect_download() as download:
        page.click("#download")
    return json.loads(download.value.path().read_text(encoding="utf-8"))


def plan(count, seed):
    """The trials that a seed stands for, from the generator's published definition (Mulberry32)."""
    state = seed

    def chance():
        nonlocal state
        state = (state + 0x6D2B79F5) & 0xFFFFFFFF
        t = ((state ^ state >> 15) * (state | 1)) & 0xFFFFFFFF
        t = ((t + ((t ^ t >> 7) * (t | 61) & 0xFFFFFFFF)) & 0xFFFFFFFF) ^ t
        return (t ^ t >> 14) / 2**32

    order = list(range(count))
    for last in range(count - 1, 0, -1):
        partner = int(chance() * (last + 1))
        order[last], order[partner] = order[partner], order[last]
    return [
        (pair, "truth" if chance() < 0.5 else "object_file", "a" if chance() < 0.5 else "b") for pair in order
    ]


def test_levels_are_matched_by_the_stated_rule():
    truth, answer, change = match(tone(440, 1e-4), tone(523, 2.0))
    assert truth.dtype == answer.dtype == np.dtype("<i2")
    span = slice(0, -441)  # before the fade
    levels = [np.sqrt(np.mean(sound[span].astype(float) ** 2)) for sound in (truth, answer)]
    assert levels[0] == pytest.approx(levels[1], rel=1e-3)
    assert max(np.abs(truth).max(), np.abs(answer).max()) == round(PEAK * 32767)
    assert change == pytest.approx(20 * np.log10(1e-4 / 2.0), abs=0.05)
    assert truth[-1] == answer[-1] == 0
    with pytest.raises(ValueError, match="silence"):
        match(np.zeros(10), np.ones(10))


def test_the_drawn_sounds_are_those_of_the_package(small_set, tmp_path, capsys):
    drawn_pairs = draw_pairs(small_set, 10, seed=3, duration_s=0.1)
    assert sorted({pair.object_id for pair in drawn_pairs}) == ["bar", "rod"]
    assert sum(pair.object_id == "bar" for pair in drawn_pairs) == 5
    assert len({(pair.object_id, pair.query) for pair in drawn_pairs}) == 10
    sounds = {
        source: {
            (sample["object_id"], sample["query"]): sample["sound"].numpy().astype(float)
            for sample in ObjectFolderDataset(small_set, "audio", "held_out", source, duration_s=0.1)
        }
        for source in ("truth", "object_file")
    }
    for pair in drawn_pairs:
        for source in ("truth", "object_file"):
            heard = getattr(pair, source)[:-441].astype(float)
            sound = sounds[source][pair.object_id, pair.query][:-441]
            factor = heard @ sound / (sound @ sound)
            # 16 bits, and a factor that is itself fitted to rounded samples.
            assert np.abs(heard - factor * sound).max() <= 0.6
    again = draw_pairs(small_set, 10, seed=3, duration_s=0.1)
    assert page_text(drawn_pairs, 3) == page_text(again, 3)
    other_pairs = draw_pairs(small_set, 10, seed=4, duration_s=0.1)
    assert [pair.query for pair in other_pairs] != [pair.query for pair in drawn_pairs]
    with pytest.raises(InputError, match="40 held-out strikes of 2 audible objects for 41"):
        draw_pairs(small_set, 41, seed=0)
    path = tmp_path / "listen.html"
    settings = ["-o", str(path), "--trials", "4", "--duration", "0.1"]
    assert main(["rod", "--root", str(small_set), *settings]) == 0
    assert capsys.readouterr().out == f"{path}: 4 trials; open it in a browser\n"
    text = path.read_text()
    assert '"object_id": "rod"' in text
    assert '"object_id": "bar"' not in text
    assert main(["cup", "--root", str(small_set), *settings]) == 1
    assert "cup" in capsys.readouterr().err


def test_a_perfect_listener_gets_all(started, pairs):
    watched = started()
    page = watched.page
    for pair, a, x in plan(TRIALS, SEED):
        heard = {letter: hear(page, letter) for letter in ("a", "b", "x")}
        for letter, role in (("a", a), ("b", "object_file" if a == "truth" else "truth")):
            assert heard[letter]["values"] == getattr(pairs[pair], role).tolist()
            assert heard[letter]["rate"] == SAMPLE_RATE_HZ
        choice = "a" if heard["x"]["values"] == heard["a"]["values"] else "b"
        assert choice == x
        page.click(f"#is-{choice}")
    assert page.inner_text("#score") == "12 of 12 right"
    assert "less than 0.001" in page.inner_text("#meaning")
    record = saved(page)
    assert record["correct"] == record["total"] == TRIALS
    assert record["p_value"] == pytest.approx(0.5**TRIALS)
    assert record["seed"] == record["page_seed"] == SEED
    assert record["participant"] == "Ada <b>"
    first = record["trials"][0]
    pair, a, x = plan(TRIALS, SEED)[0]
    assert (first["query"], first["a"], first["x"]) == (pairs[pair].query, a, x)
    assert first["plays"] == {"a": 1, "b": 1, "x": 1}
    assert first["truth_fingerprint"] == "t" * 64
    assert watched.errors == []
    assert watched.left_the_machine == []


def test_a_guessing_listener_gets_what_the_guesses_deserve_with_keys_alone(started):
    page = started(seed=77).page
    chance = random.Random(1)
    right = 0
    for _, _, x in plan(TRIALS, 77):
        for key in "abx":
            page.keyboard.press(key)
        guess = chance.choice("ab")
        right += guess == x
        page.keyboard.press({"a": "1", "b": "2"}[guess])
    assert 2 <= right <= 10  # of this seed: neither all nor none
    record = saved(page)
    assert record["seed"] == 77
    assert [entry["correct"] for entry in record["trials"]].count(True) == record["correct"] == right
    expected = binomtest(right, TRIALS, 0.5, alternative="greater").pvalue
    assert record["p_value"] == pytest.approx(expected)
    assert f"{expected:.3f}" in page.inner_text("#meaning")
    cells = [re.split(r"\s+of\s+", text) for text in page.locator("#by-object td").all_inner_texts()]
    assert sum(int(count) for count, _ in cells) == right
    assert sum(int(count) for _, count in cells) == TRIALS


def test_an_answer_needs_all_three_sounds(started):
    page = started().page
    page.keyboard.press("1")
    assert page.locator("#is-a").is_disabled()
    page.click("#play-a")
    page.click("#play-x")
    assert page.locator("#is-a").is_disabled()
    assert page.inner_text("#number") == "Trial 1 of 12"
    page.click("#play-b")
    assert page.locator("#is-a").is_enabled()
    page.click("#is-b")
    assert page.inner_text("#number") == "Trial 2 of 12"
    assert page.locator("#is-b").is_disabled()


def test_guess_probabilities_and_plans_are_exact(started):
    page = started().page
    for total in (1, 7, 24, 100, 500):
        for correct in sorted({0, 1, total // 2, total - 1, total}):
            expected = binomtest(correct, total, 0.5, alternative="greater").pvalue
            got = page.evaluate(f"guessProbability({correct}, {total})")
            assert got == pytest.approx(expected, rel=1e-9)
    for seed in (0, 1, 999_999_999):
        trials = page.evaluate(f"planTrials(Array(50).fill(0), {seed})")
        assert [(entry["pair"], entry["a"], entry["x"]) for entry in trials] == plan(50, seed)
    many = page.evaluate("planTrials(Array(4000).fill(0), 12)")
    for key, value in (("a", "truth"), ("x", "a")):
        assert abs(sum(entry[key] == value for entry in many) - 2000) < 130  # four sigma


@pytest.mark.parametrize(
    "scheme", ["light", pytest.param("dark", marks=pytest.mark.release("pipeline.publish"))]
)
def test_the_page_is_accessible(started, scheme):
    axe = Axe()
    page = started(color_scheme=scheme, viewport={"width": 360, "height": 740}).page
    assert axe.run(page).response["violations"] == []
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    for _ in range(TRIALS):
        for key in "abx1":
            page.keyboard.press(key)
    assert page.locator("#result").is_visible()
    assert axe.run(page).response["violations"] == []


def test_text_of_strangers_stays_text(open_page, pairs, tmp_path):
    name = "</script><img src=x onerror=alert(1)>"
    hostile = [Pair(name, 1, pairs[0].truth, pairs[0].object_file, 0.0, "", "")]
    path = tmp_path / "listen.html"
    path.write_text(page_text(hostile, 0), encoding="utf-8")
    watched = open_page(path)
    watched.page.click("text=Begin")
    for key in "abx1":
        watched.page.keyboard.press(key)
    assert watched.page.inner_text("#by-object th") == name
    assert watched.page.locator("img").count() == 0
    assert watched.errors == []


def test_sounds_in_the_page_are_16_bit(page_file, pairs):
    data = re.search(r'id="test">(.*?)</script>', page_file.read_text(encoding="utf-8"), re.S)
    stored = json.loads(data[1])["pairs"]
    assert np.array_equal(np.frombuffer(base64.b64decode(stored[3]["truth"]), "<i2"), pairs[3].truth)


def test_a_silent_strike_is_named(small_set, monkeypatch):
    original = ObjectFolderDataset.__getitem__

    def silent(self, index):
        sample = original(self, index)
        return {**sample, "sound": 0 * sample["sound"]}

    monkeypatch.setattr(ObjectFolderDataset, "__getitem__", silent)
    with pytest.raises(InputError, match=r"bar, query \d+: .*silence has no level"):
        draw_pairs(small_set, 1, seed=0, objects=["bar"], duration_s=0.1)


@pytest.mark.parametrize(
    ("fragment", "shown"), [("7", "7"), ("999999999", "999999999"), ("1234567890", "5"), ("-1", "5")]
)
def test_a_seed_that_the_form_refuses_is_not_taken_from_the_address(open_page, page_file, fragment, shown):
    watched = open_page("about:blank")
    watched.page.goto(f"{page_file.as_uri()}#seed={fragment}")
    assert watched.page.input_value("#seed") == shown


@pytest.mark.parametrize(
    "options",
    [
        ["--trials", "0"],
        ["--duration", "nan"],
        ["--seed", "1000000000"],
    ],
)
def test_wrong_sizes_are_refused(tmp_path, capsys, options):
    with pytest.raises(SystemExit, match="2"):
        main(["--root", str(tmp_path), "-o", str(tmp_path / "x.html"), *options])
    assert options[0] in capsys.readouterr().err
