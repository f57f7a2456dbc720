"""Rays agree with `mj_ray` on every shape, from outside and inside, and have derivatives."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

XML = """
<mujoco>
  <asset>
    <mesh name="tetrahedron" vertex="0 0 0 .3 0 0 0 .4 0 0 0 .5"/>
    <mesh name="ball" builtin="sphere" params="1" scale=".3 .2 .1"/>
    <hfield name="hills" nrow="5" ncol="7" size=".8 .6 .3 .2" elevation="0 1 2 3 4 0 3 1 0 2 3 0 0
      0 1 2 3 4 0 1 3 2 1 4 0 1 0 2 0 4 5 2 3 1 0"/>
    <material name="glass" rgba="1 1 1 0"/>
  </asset>
  <worldbody>
    <geom type="plane" size="0 0 1" pos="0 0 -1.5"/>
    <geom type="plane" size=".5 .4 1" pos="-2 0 -1" euler="20 30 0"/>
    <geom type="hfield" hfield="hills" pos="1 1 -1" euler="10 -30 20"/>
    <body pos="0 0 1"><freejoint/><geom size=".2 .3" type="capsule" group="2"/></body>
    <body pos="1 0 0"><freejoint/><geom size=".2 .3 .1" type="ellipsoid"/>
      <geom size=".2" pos="0 .4 0" group="9"/></body>
    <body pos="0 1 0"><freejoint/><geom size=".2 .3 .1" type="box"/>
      <geom size=".5" rgba="1 1 1 0"/><geom size=".6" material="glass"/></body>
    <body pos="0 -1 0"><freejoint/><geom size=".2 .3" type="cylinder"/></body>
    <body pos="-1 -1 0"><freejoint/><geom type="mesh" mesh="tetrahedron"/></body>
    <body pos="-1 1 0"><freejoint/><geom type="mesh" mesh="ball"/></body>
  </worldbody>
</mujoco>
"""


@functools.cache
def _scene() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Everything at random poses."""
    rng = np.random.default_rng(0)
    mj = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(mj)
    bodies = data.qpos.reshape(-1, 7)
    bodies[:, :3] += 0.1 * rng.normal(size=(len(bodies), 3))
    bodies[:, 3:] = rng.normal(size=(len(bodies), 4))
    mujoco.mj_normalizeQuat(mj, data.qpos)
    mujoco.mj_forward(mj, data)
    return mj, data


def _rays(rng, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays to points near geoms, one in eight from inside, with directions of any length."""
    mj, data = _scene()
    aim = data.geom_xpos[rng.integers(mj.ngeom, size=count)] + 0.2 * rng.normal(size=(count, 3))
    origin = 1.2 * rng.normal(size=(count, 3))
    origin[::8] = aim[::8] + 0.05 * rng.normal(size=aim[::8].shape)
    return origin, (aim - origin) * rng.uniform(0.1, 2, (count, 1))


def _oracle(origin, direction, groups=None, static=True, exclude=-1):
    """(count, 5): distance, geom and normal of each ray."""
    mj, data = _scene()
    geom, normal, rows = np.zeros(1, np.int32), np.zeros(3), []
    for p, d in zip(origin, direction, strict=True):
        t = mujoco.mj_ray(mj, data, p, d, groups, static, exclude, geom, normal)
        rows.append([t, geom[0], *normal])
    return np.array(rows)


def _model_and_state():
    mj, data = _scene()
    model = jaxsim.load(mj)
    return model, jaxsim.make_state(model).replace(qpos=jnp.asarray(data.qpos, float))


def _cast(mapped=jax.vmap, **options):
    ray = lambda *a: jaxsim.ray(*a, **options)  # noqa: E731
    return quick_jit(mapped(ray, in_axes=(None, None, 0, 0)))


@pytest.mark.filterwarnings("ignore:convex hulls")
def test_every_shape_agrees_with_mujoco(rng, x64):
    origin, direction = _rays(rng, 4000)
    expected = _oracle(origin, direction)
    nowhere = np.zeros((1, 3))
    hit = _cast()(*_model_and_state(), *(np.append(x, nowhere, 0) for x in (origin, direction)))
    assert hit.distance[-1] == hit.geom[-1] == -1
    hit = jax.tree.map(lambda x: x[:-1], hit)
    np.testing.assert_allclose(hit.distance, expected[:, 0], atol=1e-9)
    np.testing.assert_array_equal(hit.geom, expected[:, 1])
    np.testing.assert_allclose(hit.normal, expected[:, 2:], atol=1e-9)
    seen = np.isin(np.arange(_scene()[0].ngeom), expected[:, 1])
    assert seen.sum() == 10  # all but the transparent ones
    assert (expected[:, 0] < 0).sum() > 300


@pytest.mark.parametrize("mapped", [jax.vmap, jaxsim.vmap])
@pytest.mark.filterwarnings("ignore:convex hulls")
def test_float32_and_what_is_seen(rng, mapped):
    origin, direction = _rays(rng, 1000)
    groups = np.array([1, 0, 0, 0, 0, 1], np.uint8)
    expected = _oracle(origin, direction, groups, False, 5)
    options = {"geomgroup": groups, "flg_static": False, "bodyexclude": 5}
    hit = _cast(mapped, **options)(*_model_and_state(), *map(jnp.float32, (origin, direction)))
    # A ray may pass an edge on the other side.
    same = np.asarray(hit.geom) == expected[:, 1]
    assert same.mean() > 0.995
    error = np.abs(hit.distance - expected[:, 0])[same]
    assert np.quantile(error, 0.99) < 1e-4
    assert not set(expected[:, 1]) & {0.0, 1, 2, 3}


@pytest.mark.filterwarnings("ignore:convex hulls")
def test_derivatives_of_the_distance(rng, x64):
    model, state = _model_and_state()
    origin, direction = _rays(rng, 200)

    def distances(size, qpos, origin, direction):
        moved = model.replace(geom_size=size), state.replace(qpos=qpos)
        cast = jax.vmap(lambda *a: jaxsim.ray(*moved, *a).distance)
        return cast(origin, direction)

    at = (model.geom_size, state.qpos, jnp.asarray(origin), jnp.asarray(direction))
    step = [jnp.asarray(rng.normal(size=x.shape)) for x in at]
    step[0] = step[0].at[0].set(0)  # a plane of size zero has no edge
    weight = jnp.asarray(rng.normal(size=len(origin)))

    @quick_jit
    def both(*at):
        value, along = jax.jvp(distances, at, tuple(step))
        return value, along, jax.grad(lambda *a: weight @ distances(*a), (0, 1, 2, 3))(*at)

    def beside(h):
        return tuple(x + h * dx for x, dx in zip(at, step, strict=True))

    h = 1e-6
    (up, *_), (down, *_), (middle, along, gradient) = (both(*beside(s)) for s in (h, -h, 0.0))
    difference = (up - down) / (2 * h)
    # No derivative where another feature is hit within the difference.
    smooth = np.abs(up - 2 * middle + down) < 1e-3 * h * (1 + np.abs(difference))
    assert smooth.mean() > 0.95
    np.testing.assert_allclose(along[smooth], difference[smooth], atol=1e-5, rtol=1e-5)
    reverse = sum(jnp.vdot(g, dx) for g, dx in zip(gradient, step, strict=True))
    np.testing.assert_allclose(reverse, weight @ along, rtol=1e-9)


def test_rays_through_lattice_points_do_not_slip_through(x64):
    elevation = " ".join(str(i % 2) for i in range(81))
    model = jaxsim.load(f"""<mujoco><asset>
      <hfield name="field" nrow="9" ncol="9" size="1 1 1 .1" elevation="{elevation}"/></asset>
      <worldbody><geom type="hfield" hfield="field"/></worldbody></mujoco>""")
    x = np.linspace(-1, 1, 9)[1:-1]
    origin = np.stack([*np.meshgrid(x, x), np.full((7, 7), 3.0)], axis=-1).reshape(-1, 3)
    down = np.tile([0.0, 0.0, -1.0], (len(origin), 1))
    hit = _cast()(model, jaxsim.make_state(model), origin, down)
    heights = np.arange(81).reshape(9, 9)[1:-1, 1:-1].ravel() % 2
    np.testing.assert_allclose(hit.distance, 3 - heights, atol=1e-12)


def test_arguments_are_judged():
    model = jaxsim.load("pendulum")
    with pytest.raises(ValueError, match=r"direction must have shape \(3,\)"):
        jaxsim.ray(model, jaxsim.make_state(model), jnp.zeros(3), jnp.zeros(2))
