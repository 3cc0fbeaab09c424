"""Pictures of what `bench.senses.touch` and `bench.senses.touch_tacto` measured."""

from typing import Any

import numpy as np

from bench.record import save, subplots

SHOWN_PAIRS = 6
COLOURS = {"vertex": "tab:blue", "crease": "tab:orange", "vertex, ours crease": "tab:red"}


def draw_tacto(
    summary: dict[str, dict[str, dict[str, Any]]],
    rows: list[dict[str, Any]],
    pictures: list[tuple[float, np.ndarray, np.ndarray]],
) -> None:
    """Error over samples, its spread over poses, and the worst images beside TACTO's."""
    figure, (by_samples, by_pose, shown) = subplots(1, 3, figsize=(13, 4.2), width_ratios=(1, 1, 1.3))
    for normals, found in summary.items():
        samples = [int(key) for key in found]
        for measure, line in (("mean", "o-"), ("worst", "v--")):
            values = [one[f"raw_psnr_{measure}_db"] for one in found.values()]
            by_samples.plot(
                samples, values, line, color=COLOURS[normals], label=f"{normals} normals, {measure}"
            )
        empty = next(iter(found.values()))["empty_raw_psnr_mean_db"]
        ordered = sorted(
            row["raw_psnr_db"]
            for row in rows
            if row["normals"] == normals and row["samples"] == 2 and row["share_in_contact"] > 0
        )
        by_pose.plot(
            np.linspace(0, 1, len(ordered)), ordered, color=COLOURS[normals], label=f"{normals} normals"
        )
    by_samples.axhline(empty, color="black", lw=0.8, ls=":", label="no contact at all, mean")
    by_samples.set(xlabel="samples along a pixel's side", ylabel="PSNR against TACTO, dB", xticks=samples)
    by_pose.set(xlabel="share of poses", ylabel="PSNR against TACTO at 2 x 2, dB")
    for axis in (by_samples, by_pose):
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7)
    if pictures:
        columns = [
            np.concatenate([theirs, ours, difference(theirs, ours)])
            for _, theirs, ours in pictures[:SHOWN_PAIRS]
        ]
        shown.imshow(np.concatenate(columns, axis=1))
        shown.set_title("worst: TACTO, ours, difference x 8", fontsize=9)
    shown.axis("off")
    save(figure, "touch_tacto")


def difference(truth: np.ndarray, answer: np.ndarray, gain: float = 8.0) -> np.ndarray:
    """Difference of 8-bit images, amplified round grey."""
    signed = (answer.astype(np.float64) - truth) * gain + 128
    return np.clip(signed, 0, 255).astype(np.uint8)


def draw_touch(summary: dict[str, Any], encoded: list[dict[str, Any]]) -> None:
    """Error against seconds; rates over the size of images; bytes and reach of stored surfaces."""
    figure, (by_time, by_size, by_object) = subplots(1, 3, figsize=(15, 4.8), width_ratios=(1.5, 1, 1.3))
    ways = summary["ways"]
    for name in dict.fromkeys(way["way"] for way in ways):
        found = [way for way in ways if way["way"] == name]
        errors = [way["psnr_contact_db"] for way in found]
        if "cpu_s" not in found[0]:
            by_time.axhline(errors[0], lw=0.8, ls=":", color="black")
            by_time.annotate(
                name, (0.02, errors[0]), fontsize=7, xytext=(0, 2), textcoords="offset points",
                xycoords=by_time.get_yaxis_transform(),
            )  # fmt: skip
            continue
        trained = f", {found[0]['training_cpu_s']:.0f} CPU s" if "training_cpu_s" in found[0] else ""
        by_time.plot([way["cpu_s"] for way in found], errors, "o-", ms=4, label=name + trained)
        for way in found:
            if way["setting"] is not None:
                by_time.annotate(
                    str(way["setting"]), (way["cpu_s"], way["psnr_contact_db"]), fontsize=7,
                    xytext=(3, 3), textcoords="offset points",
                )  # fmt: skip
    by_time.set(xscale="log", xlabel="CPU seconds a touch", ylabel="PSNR in the contact region, dB")
    by_time.legend(fontsize=7)
    sizes = sorted({(row["height"], row["width"]) for row in summary["sizes"]})
    for samples in sorted({row["samples"] for row in summary["sizes"]}):
        rates = [
            row["touches_a_cpu_s"]
            for row in sorted(summary["sizes"], key=lambda row: row["height"])
            if row["samples"] == samples
        ]
        by_size.plot(range(len(sizes)), rates, "o-", label=f"{samples} x {samples}")
    by_size.set_xticks(range(len(sizes)), [f"{width} x {height}" for height, width in sizes])
    by_size.set(yscale="log", ylabel="touches a CPU second")
    by_size.legend(fontsize=7)
    ordered = sorted(encoded, key=lambda row: row["bytes"])
    places = np.arange(len(ordered))
    by_object.barh(places, [row["bytes"] / 1e3 for row in ordered], color="tab:gray", alpha=0.6)
    by_object.set_yticks(places, [row["object"][:24] for row in ordered], fontsize=6)
    by_object.set_xlabel("kB of stored surface (bars)")
    share = by_object.twiny()
    share.plot([100 * row["unreachable_share"] for row in ordered], places, "o", ms=4, color="tab:red")
    share.set_xlim(0, 100)
    share.set_xlabel("% of the area out of reach (dots)")
    for axis in (by_time, by_size, by_object):
        axis.grid(alpha=0.3)
    save(figure, "touch")
