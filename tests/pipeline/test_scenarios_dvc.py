"""Experiments of DVC, which run in a temporary copy."""

import pytest
from repositories import Repository

OBJECTS = ("ball", "cup", "dish")


@pytest.fixture
def repository(toys) -> Repository:
    return Repository(toys)


@pytest.mark.slow
@pytest.mark.release("pipeline.run", "pipeline.store")
def test_experiments_in_a_temporary_copy_do_what_is_left(repository):
    repository.make()
    repository.commit("first")
    status = repository.run("git", "status", "--porcelain").stdout

    def experiment(*options: str) -> list[str]:
        repository.run("dvc", "exp", "run", "--temp", "-q", *options)
        return repository.executed()

    assert experiment() == []
    # The products of the checkout come along.
    changed = experiment("-n", "seven", "-S", "sizes.default.vision.training_views=7")
    assert changed == sorted(f"{stage} {object_id}" for stage in ("tune", "encode") for object_id in OBJECTS)
    assert repository.run("git", "status", "--porcelain").stdout == status
    # Taken over, an experiment brings its products with it.
    repository.run("dvc", "exp", "apply", "-q", "seven")
    assert repository.repro() == []
