"""Batches in chunks: sizes that divide, and results in the order of the batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.arrays import tuning
from jaxsim.parallel import chunks
from jaxsim.parallel.chunks import KEPT, UNROLLED, chunk_lanes, even_lanes, map_chunks


@pytest.fixture(scope="module")
def model():
    return jaxsim.load("pendulum")


@pytest.fixture(params=[UNROLLED, KEPT], ids=["unrolled", "kept"])
def limits(request, monkeypatch):
    monkeypatch.setattr(chunks, "lane_limits", lambda: request.param)
    return request.param


@pytest.mark.parametrize(
    ("count", "unrolled", "kept"),
    [(8, 8, 8), (512, 128, 64), (300, 100, 60), (480, 96, 48), (257, 257, 257), (272, 68, 34)],
)
def test_even_lanes(model, limits, count, unrolled, kept):
    """Whole vectors if possible, and all together where the parts would be too short."""
    assert even_lanes(model, count) == (unrolled if limits is UNROLLED else kept)


def test_large_models_come_in_small_chunks(limits):
    few, many = (chunk_lanes(jaxsim.load(_spheres(n))) for n in (2, 60))
    assert limits.min_lanes <= many < few <= limits.max_lanes
    assert few % tuning.VECTOR == many % tuning.VECTOR == 0


def _spheres(count):
    one = '<body pos="{} 0 1"><freejoint/><geom size=".1" conaffinity="2"/></body>'
    balls = "".join(one.format(i) for i in range(count))
    return f'<mujoco><worldbody><geom type="plane" size="1 1 1"/>{balls}</worldbody></mujoco>'


@pytest.mark.parametrize("batch", [129, 257, 400])
def test_rollouts_in_chunks(batch):
    """A batch that fills no chunks gives the same as its parts."""
    model = jaxsim.load("pendulum")
    state = jaxsim.make_state(model)
    angles = jnp.linspace(0, 3, batch)[:, None]
    states = jax.vmap(lambda q: state.replace(qpos=q))(angles)
    ctrls = jnp.zeros((batch, 3, model.nu))
    last = jaxsim.batch_rollout(model, states, ctrls)
    some = jax.tree.map(lambda x: x[-5:], (states, ctrls))
    np.testing.assert_allclose(last.qpos[-5:], jaxsim.batch_rollout(model, *some).qpos, rtol=1e-6)


def test_map_chunks():
    x, words = jnp.arange(12.0), {"a": jnp.arange(24.0).reshape(12, 2)}
    seen = []

    def f(x, words):
        seen.append(x.shape)
        return x * 2, words["a"].sum(axis=1)

    for lanes in (12, 4, 1):
        twice, sums = map_chunks(f, lanes, x, words)
        np.testing.assert_array_equal(twice, 2 * x)
        np.testing.assert_array_equal(sums, words["a"].sum(axis=1))
        assert seen[-1] == (lanes,)
