"""Rates of the mode bank: ``python -m bench.senses.mode_bank``, about a minute.

256 modes spread evenly from 560 Hz to 19.8 kHz with the damping of ceramic, 2 s at 44.1 kHz. The rates are
mode-samples a CPU second, modes times samples of the sound that is asked for: a way that leaves out what has
died away answers the same question. The rate of those it did compute is given, too, and without damping
nothing can be left out.
"""

import time
from collections.abc import Callable
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import mpmath
import numpy as np
from scipy.signal import lfilter

from bench import record
from objectfolder.audio.synthesis import Voices, mode_bank
from objectfolder.audio.synthesis.bank import FLOOR_DB, Bank
from objectfolder.audio.synthesis.oscillators import Oscillators

MODES = 256
RATE_HZ = 44100
DURATION_S = 2.0
SAMPLES = round(DURATION_S * RATE_HZ)
ALPHA_PER_S, BETA_S = 6.0, 1e-7
REPETITIONS = 7
CONTACTS = (1, 4, 16, 64)
BLOCKS = (64, 128, 256, 512)
FLOORS_DB = (FLOOR_DB, -100.0, -60.0)
ONSETS = 400
CHECKED = (0, 1, 50, 591, 592, 4410, 30001, 88199)


def case() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues, dampings and amplitudes (contacts, modes)."""
    random = np.random.default_rng(0)
    eigenvalues = (2 * np.pi * np.sort(random.uniform(560.0, 19800.0, MODES))) ** 2
    return eigenvalues, (ALPHA_PER_S + BETA_S * eigenvalues) / 2, random.normal(size=(max(CONTACTS), MODES))


def naive(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Sum over modes of exponential times cosine and sine."""
    t = np.arange(SAMPLES) / RATE_HZ
    sound = np.zeros(SAMPLES)
    for square, c, a in zip(eigenvalues, dampings, amplitudes, strict=True):
        root = np.sqrt(square - c * c)
        sound += a * np.exp(-c * t) * (np.cos(root * t) - c / root * np.sin(root * t))
    return sound


def recursive(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Sum over modes of recursive filters of order 2, scipy's."""
    impulse = np.zeros(SAMPLES)
    impulse[0] = 1.0
    sound = np.zeros(SAMPLES)
    h = 1 / RATE_HZ
    for square, c, a in zip(eigenvalues, dampings, amplitudes, strict=True):
        root = np.sqrt(square - c * c)
        decay = np.exp(-c * h)
        first = decay * (np.cos(root * h) - c / root * np.sin(root * h))
        poles = [1.0, -2 * decay * np.cos(root * h), decay**2]
        sound += a * lfilter([1.0, first + poles[1], 0.0], poles, impulse)
    return sound


def single_precision(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """The two-level product in float32, its tables rounded from float64."""
    oscillators = Oscillators.checked(eigenvalues, dampings, RATE_HZ)
    bank = Bank(oscillators, oscillators.response_weights("velocity"), SAMPLES, FLOOR_DB)
    ordered = np.ascontiguousarray(amplitudes[None, bank.order])
    a, b = bank.coefficients((np.zeros_like(ordered), ordered), 0.0)
    blocks = -(-SAMPLES // bank.block)
    basis = bank.oscillators.basis(bank.block * np.arange(blocks))
    m0, m1, m2, m3 = bank.oscillators.shift_matrix(basis)
    # Seconds for sines in the second half of the product leave the range of float32; radians do not.
    root = bank.oscillators.roots_per_s
    rows = np.concatenate([m0 * a + m1 * b, (m2 * a + m3 * b) / root], axis=1).astype(np.float32)
    fine = np.concatenate([bank.fine[::2], bank.fine[1::2] * root[:, None]]).astype(np.float32)
    return (rows @ fine).reshape(-1)[:SAMPLES]


def truth(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """The closed form at the samples `CHECKED`, 40 digits."""
    found = []
    with mpmath.workdps(40):
        for sample in CHECKED:
            t = mpmath.mpf(sample) / RATE_HZ
            terms = []
            for square, c, a in zip(
                eigenvalues.tolist(), dampings.tolist(), amplitudes.tolist(), strict=True
            ):
                root = mpmath.sqrt(mpmath.mpf(square) - mpmath.mpf(c) ** 2)
                turn = mpmath.cos(root * t) - c / root * mpmath.sin(root * t)
                terms.append(a * mpmath.exp(-c * t) * turn)
            found.append(float(mpmath.fsum(terms)))
    return np.array(found)


def seconds(run: Callable[[], Any], repetitions: int = REPETITIONS) -> float:
    """Median CPU seconds of some runs, after one."""
    run()
    taken = []
    for _ in range(repetitions):
        begin = time.process_time()
        run()
        taken.append(time.process_time() - begin)
    return float(np.median(taken))


def batches(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> list[dict[str, Any]]:
    """Rates of the mode bank over numbers of contacts, with damping and without."""
    rows = []
    for damped in (True, False):
        c = dampings * damped
        oscillators = Oscillators.checked(eigenvalues, c, RATE_HZ)
        work = Bank(oscillators, oscillators.response_weights("velocity"), SAMPLES, FLOOR_DB).work(SAMPLES)
        for count in CONTACTS:
            given = amplitudes[:count]
            spent = seconds(lambda c=c, given=given: mode_bank(eigenvalues, c, given, DURATION_S, RATE_HZ))
            asked = count * MODES * SAMPLES / spent / 1e9
            rows.append(
                {
                    "contacts": count,
                    "damped": damped,
                    "giga_mode_samples_per_s": asked,
                    "computed_giga_mode_samples_per_s": asked * work,
                }
            )
    return rows


def streams(eigenvalues: np.ndarray, dampings: np.ndarray, amplitudes: np.ndarray) -> list[dict[str, Any]]:
    """Rates of a stream with all modes ringing, and the time to the first block of a new contact."""
    rows = []
    for block in BLOCKS:
        voices = Voices.of_modes(eigenvalues, 0 * dampings, RATE_HZ)
        voices.strike(amplitudes[0])
        voices.block(block)
        ringing = (
            seconds(lambda voices=voices, block=block: [voices.block(block) for _ in range(200)], 5) / 200
        )
        row = {"block_samples": block, "ringing_giga_mode_samples_per_s": MODES * block / ringing / 1e9}
        for name, pulse_s in (("impulse", None), ("pulse_0.1_ms", 1e-4), ("pulse_1_ms", 1e-3)):
            voices = Voices.of_modes(eigenvalues, dampings, RATE_HZ)
            spent = []
            for index in range(ONSETS):
                amplitude = amplitudes[index % len(amplitudes)]
                begin = time.process_time_ns()
                voices.strike(amplitude, at=voices.now + 17, pulse_s=pulse_s)
                voices.block(block)
                spent.append((time.process_time_ns() - begin) / 1e6)
            row[f"first_block_ms_{name}"] = float(np.median(spent))
            row[f"first_block_ms_{name}_p99"] = float(np.quantile(spent, 0.99))
        rows.append(row)
    return rows


def main() -> None:
    eigenvalues, dampings, amplitudes = case()
    one = amplitudes[0]
    ways: dict[str, Callable[[], np.ndarray]] = {
        "naive, float64": lambda: naive(eigenvalues, dampings, one),
        "scipy lfilter, float64": lambda: recursive(eigenvalues, dampings, one),
        "two-level, float32": lambda: single_precision(eigenvalues, dampings, one),
        "ours, float64": lambda: mode_bank(eigenvalues, dampings, one, DURATION_S, RATE_HZ)[0],
    }
    expected = truth(eigenvalues, dampings, one)
    single = {}
    for name, run in ways.items():
        sound = run()
        spent = seconds(run, 3 if "two" not in name and "ours" not in name else REPETITIONS)
        single[name] = {
            "giga_mode_samples_per_s": MODES * SAMPLES / spent / 1e9,
            "largest_error_over_peak": float(
                np.abs(sound[list(CHECKED)] - expected).max() / np.abs(sound).max()
            ),
        }
    oscillators = Oscillators.checked(eigenvalues, dampings, RATE_HZ)
    weights = oscillators.response_weights("velocity")
    left = {
        f"{floor_db:g} dB": Bank(oscillators, weights, SAMPLES, floor_db).work(SAMPLES, after=RATE_HZ // 10)
        for floor_db in FLOORS_DB
    }
    figures = {
        "one_contact": single,
        "ours_over_naive": single["ours, float64"]["giga_mode_samples_per_s"]
        / single["naive, float64"]["giga_mode_samples_per_s"],
        "batch": batches(eigenvalues, dampings, amplitudes),
        "stream": streams(eigenvalues, dampings, amplitudes),
        "share_of_work_after_100_ms": left,
    }
    settings = {
        "modes": MODES,
        "sample_rate_hz": RATE_HZ,
        "duration_s": DURATION_S,
        "damping": f"Rayleigh, alpha {ALPHA_PER_S} 1/s, beta {BETA_S} s (ceramic)",
        "floor_db": FLOOR_DB,
        "repetitions": REPETITIONS,
        "onsets": ONSETS,
        "time": "CPU seconds, one thread, medians",
        "error": f"at samples {list(CHECKED)} against the closed form in 40 digits",
    }
    record.write(
        "mode_bank",
        figures,
        settings,
        "The sound of 256 modes for 2 s by the naive sum, recursive filters, and the two-level product; the "
        "product over numbers of contacts; and streams of blocks",
    )
    draw(figures)


def draw(figures: dict[str, Any]) -> None:
    """Draw rates, and the time to a first block."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for damped, style in ((True, "o-"), (False, "s--")):
        rows = [row for row in figures["batch"] if row["damped"] == damped]
        label = "ours, damped (dead modes left out)" if damped else "ours, undamped (all computed)"
        left.loglog(
            [r["contacts"] for r in rows], [r["giga_mode_samples_per_s"] for r in rows], style, label=label
        )
    for name, colour in (("naive, float64", "tab:red"), ("scipy lfilter, float64", "tab:brown")):
        rate = figures["one_contact"][name]["giga_mode_samples_per_s"]
        left.axhline(rate, color=colour, linestyle=":", label=f"{name}, any number")
    left.axhline(1.0, color="black", linewidth=0.8)
    left.set(xlabel="contacts in the batch", ylabel="1e9 mode-samples a CPU second", xticks=CONTACTS)
    left.set_xticklabels(CONTACTS)
    left.set_title("256 modes, 2 s at 44.1 kHz, one core")
    left.legend(fontsize=8, loc=(0.43, 0.2))
    for name, label in (
        ("impulse", "impulse"),
        ("pulse_0.1_ms", "0.1 ms pulse"),
        ("pulse_1_ms", "1 ms pulse"),
    ):
        right.plot(BLOCKS, [r[f"first_block_ms_{name}"] for r in figures["stream"]], "o-", label=label)
    right.axhline(1.0, color="black", linewidth=0.8)
    right.set(xlabel="samples of a block", ylabel="CPU ms (median)", xticks=BLOCKS, ylim=(0, 1.5))
    right.set_title("Contact to first block, 256 modes")
    right.legend(fontsize=8)
    figure.savefig(record.RESULTS / "mode_bank.png", dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()
