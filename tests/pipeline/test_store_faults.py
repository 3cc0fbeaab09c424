"""Runs against a store that fails at random: all bytes right, nothing torn, nothing finished made again."""

import pytest
import s3_server
from store_trials import Trials, is_right

SEEDS = range(3, 7)  # two with workers elsewhere, two with the store as a cache


@pytest.mark.slow
def test_runs_against_a_store_that_fails_at_random(toys, tmp_path_factory):
    with s3_server.serving() as server:
        trials = Trials(toys, server, tmp_path_factory.mktemp("worker"))
        outcomes = [trials.run(seed) for seed in SEEDS]
    assert [outcome for outcome in outcomes if not is_right(outcome)] == []
    # The trials tried something.
    assert sum(sum(outcome["faults"].values()) for outcome in outcomes) > 5 * len(SEEDS)
    assert sum(outcome["refused"] for outcome in outcomes) > 0
    assert sum(outcome["writes_without_space"] for outcome in outcomes) > 0
    assert len({outcome["mode"] for outcome in outcomes}) == 2
