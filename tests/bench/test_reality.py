"""The page of the comparison with real things."""

from bench.reality.row import Row, page


def test_the_page_groups_lines_by_sense_and_cites_each_source_once():
    row = Row("sound", "a bowl", "decay", {"median": 1.04, "worst": 1.9}, "", "", "all", "Who, 2024", 2)
    other = Row("touch", "a gel", "force, %", {"worst": 2.5}, "1 %", "its modulus", "half", "Whom, 2023", 0.2)
    text = page([row, row, other])
    assert text.count("| a bowl | decay | median 1.04, worst 1.9 | not known | nothing | all | 2.0 |") == 2
    assert text.index("## Sound") < text.index("a bowl") < text.index("## Touch") < text.index("a gel")
    assert text.count("Who, 2024") == 1
