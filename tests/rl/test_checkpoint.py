"""Checkpoints: all or nothing, whatever happens to their files."""

import pathlib
import shutil
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.rl.checkpoint import CheckpointError, Checkpoints


def training(scale: float) -> dict:
    weights = scale * jnp.arange(2000.0).reshape(20, 100)
    return {"weights": weights, "key": jax.random.key(int(scale)), "none": jnp.zeros((0, 3))}


@pytest.fixture(scope="module")
def two(tmp_path_factory) -> pathlib.Path:
    """A directory with the checkpoints of steps 1 and 2."""
    folder = tmp_path_factory.mktemp("two")
    store = Checkpoints(folder)
    for steps in (1, 2):
        store.save(steps, training(steps), {"scale": jnp.float32(steps)}, {"seconds": 0.5 * steps})
    store.close()
    return folder


@pytest.fixture
def copy(two, tmp_path) -> pathlib.Path:
    """A copy to damage."""
    shutil.copytree(two, tmp_path / "copy")
    return tmp_path / "copy"


def restored(folder: pathlib.Path, like: dict):
    store = Checkpoints(folder)
    try:
        return store.restore(like)
    finally:
        store.close()


def files(folder: pathlib.Path) -> list[pathlib.Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_everything_comes_back(two):
    steps, found, progress = restored(two, training(0))
    assert (steps, progress) == (2, {"seconds": 1.0})
    np.testing.assert_array_equal(found["weights"], training(2)["weights"])
    assert jax.random.key_data(found["key"])[1] == 2
    assert found["none"].shape == (0, 3)


@pytest.mark.parametrize("damage", ["cut", "emptied", "removed", "changed"])
def test_a_damaged_checkpoint_is_passed_over(copy, damage):
    """Each file of the newest checkpoint in turn: it is read as it was, or not at all."""
    for path in files(copy / "checkpoints" / "2"):
        content = path.read_bytes()
        middle = len(content) // 2
        if damage == "removed":
            path.unlink()
        elif damage == "changed":
            path.write_bytes(
                content[:middle] + bytes([content[middle] ^ 85]) + content[middle + 1 :]
            )
        else:
            path.write_bytes(content[: middle if damage == "cut" else 0])
        store = Checkpoints(copy, read_only=True)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            scale = float(store.restore_policy({"scale": jnp.float32(0)})["scale"])
        store.close()
        assert scale == 2 - len(told)
        assert all("checkpoint 2 cannot be used" in str(warning.message) for warning in told)
        path.write_bytes(content)


def test_the_older_checkpoint_is_used_and_the_damaged_one_written_again(copy):
    for path in files(copy / "checkpoints" / "2" / "training"):
        path.write_bytes(b"")
    with pytest.warns(UserWarning, match="checkpoint 2 cannot be used.*going back to 1"):
        steps, found, _ = restored(copy, training(0))
    assert steps == 1
    np.testing.assert_array_equal(found["weights"], training(1)["weights"])
    store = Checkpoints(copy)
    assert store.steps() == [1]
    store.save(2, training(2), {"scale": jnp.float32(2)}, {"seconds": 1.0})
    store.close()
    assert restored(copy, training(0))[0] == 2


def test_no_usable_checkpoint_is_one_error(copy, tmp_path):
    for path in files(copy / "checkpoints"):
        path.write_bytes(b"")
    with pytest.raises(CheckpointError, match="checkpoint 2 cannot be used.*checkpoint 1 cannot"):
        restored(copy, training(0))
    with pytest.raises(CheckpointError, match="contains no checkpoint"):
        Checkpoints(tmp_path, read_only=True)


def test_a_checkpoint_of_something_else_says_what_differs(copy):
    with pytest.raises(CheckpointError, match=r"another environment.*\['weights'\] is of shape"):
        restored(copy, training(0) | {"weights": jnp.zeros((10, 200))})
    with pytest.raises(CheckpointError, match=r"\['more'\] is of shape None, here of \[2\]"):
        restored(copy, training(0) | {"more": jnp.zeros(2)})


def test_reading_changes_nothing(copy):
    before = {path: path.read_bytes() for path in files(copy)}
    store = Checkpoints(copy, read_only=True)
    store.restore_policy({"scale": jnp.float32(0)})
    store.close()
    assert {path: path.read_bytes() for path in files(copy)} == before
