"""Detection on whole models: against MuJoCo, and with fewer slots than candidates."""

import importlib.util
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.collision import detect, find_candidates
from jaxsim.lanes import as_kernel

PARAMETERS = ("includemargin", "friction", "solref", "solreffriction", "solimp")

# Everything that is supported in one scene: self-collision, three condims, priorities, a pair.
# Boxes, cylinders and ellipsoids meet planes only.
ZOO = """<mujoco>
  <default><default class="prop"><geom contype="2" conaffinity="0"/></default>
    <default class="plane"><geom type="plane" size="5 5 1" contype="3" conaffinity="3"/></default>
  </default>
  <worldbody>
  <geom name="floor" class="plane" margin=".01" euler="5 0 0"/>
  <geom name="wall" class="plane" pos="-.4 0 0" euler="0 80 0" condim="6"/>
  <body pos="0 0 .1"><freejoint/><geom name="ball" size=".1" priority="1" friction=".3"/>
    <body pos=".2 0 0"><joint axis="0 1 0"/><geom name="arm" type="capsule" size=".05 .1"/>
      <body pos=".2 0 0"><joint axis="0 0 1"/>
        <geom name="hand" type="capsule" size=".05 .1" margin=".02" gap=".03"/></body></body></body>
  <body pos="0 .2 .1"><freejoint/><geom name="head" size=".12" solmix="2" condim="1"/></body>
  <body pos="0 .4 .1"><freejoint/><geom class="prop" type="box" size=".1 .06 .08"/></body>
  <body pos="0 .6 .1"><freejoint/><geom class="prop" type="cylinder" size=".1 .08"/></body>
  <body pos="0 .8 .1"><freejoint/><geom class="prop" type="ellipsoid" size=".1 .06 .08"/></body>
  </worldbody>
  <contact><pair geom1="head" geom2="ball" friction=".1 .2 .3 .4 .5" margin=".05" condim="4"/>
  </contact></mujoco>"""


def models():
    """The scene above, and models of self-colliding robots where their package is installed."""
    yield "zoo", None
    for package, path in (
        ("gymnasium", "envs/mujoco/assets/humanoid.xml"),
        ("gymnasium", "envs/mujoco/assets/ant.xml"),
        ("mujoco", "mjx/test_data/humanoid/humanoid.xml"),
    ):
        spec = importlib.util.find_spec(package)
        if spec is not None and spec.submodule_search_locations:
            file = Path(spec.submodule_search_locations[0], path)
            if file.exists():
                yield f"{package}-{file.stem}", file


def load(file):
    if file is None:
        return mujoco.MjModel.from_xml_string(ZOO)
    return mujoco.MjModel.from_xml_path(str(file))


def random_data(model, rng, n, spread):
    """MuJoCo's data after its collision stage in random configurations."""
    datas = []
    for _ in range(n):
        data = mujoco.MjData(model)
        mujoco.mj_integratePos(model, data.qpos, spread * rng.normal(size=model.nv), 1.0)
        mujoco.mj_fwdPosition(model, data)
        datas.append(data)
    return datas


def poses(datas):
    xpos = jnp.asarray(np.stack([d.geom_xpos for d in datas]))
    xmat = jnp.asarray(np.stack([d.geom_xmat.reshape(-1, 3, 3) for d in datas]))
    return xpos, xmat


def assert_same_active_contacts(ours, data):
    """Match the active contacts of one environment one to one, geom pair by geom pair."""
    active = np.nonzero(ours.dist < ours.includemargin)[0].tolist()
    expected = [c for c in data.contact if c.exclude == 0]
    assert len(active) == len(expected)
    for c in expected:
        same = [i for i in active if (ours.geom1[i], ours.geom2[i]) == tuple(c.geom)]
        i = min(same, key=lambda i: np.abs(ours.pos[i] - c.pos).max() + abs(ours.dist[i] - c.dist))
        active.remove(i)
        assert ours.condim[i] == c.dim
        np.testing.assert_allclose(ours.dist[i], c.dist, atol=1e-10)
        np.testing.assert_allclose(ours.pos[i], c.pos, atol=1e-10)
        np.testing.assert_allclose(ours.frame[i].ravel(), c.frame, atol=1e-10)
        for name in PARAMETERS:
            np.testing.assert_allclose(getattr(ours, name)[i], getattr(c, name), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "file"), list(models()), ids=lambda x: x if isinstance(x, str) else ""
)
@pytest.mark.parametrize("limits", [{}, {"max_geom_pairs": 20, "max_contacts": 30}], ids=len)
def test_agrees_with_mujoco(name, file, limits, rng):
    model = load(file)
    candidates = find_candidates(model, **limits)
    datas = random_data(model, rng, 40, spread=0.25)
    contacts = jax.jit(jax.vmap(lambda x, r: detect(model, candidates, x, r)))(*poses(datas))
    assert contacts.dist.shape == (40, candidates.ncon)
    contacts = jax.device_get(contacts)
    complete = contacts.overflow == 0
    assert complete.all() if not limits else complete.any()
    for i in np.nonzero(complete)[0]:
        assert_same_active_contacts(jax.tree.map(lambda x, i=i: x[i], contacts), datas[i])
    assert sum(d.ncon for d in datas) > 20


def test_ids_are_static_when_every_candidate_has_its_slots(rng):
    model = load(None)
    [data] = random_data(model, rng, 1, 0.1)
    xpos, xmat = (x[0] for x in poses([data]))

    def kinds(candidates):
        found = []

        def f(x, r):
            contacts = detect(model, candidates, x, r)
            found.extend(type(i) is np.ndarray for i in (contacts.geom1, contacts.geom2))
            return contacts.dist

        jax.eval_shape(f, xpos, xmat)
        return found

    every, few = find_candidates(model), find_candidates(model, max_contacts=2)
    assert kinds(every) == [not every.dynamic] * 2 == [True, True]
    assert kinds(few) == [not few.dynamic] * 2 == [False, False]


def test_the_ground_stays_known_when_slots_are_assigned_at_run_time():
    """So the solver knows that one side of these contacts never moves."""
    balls = '<body pos="{0} 0 {0}"><freejoint/><geom size=".1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1" conaffinity="2" contype="2"/>'
        + "".join(balls.format(x) for x in (0.3, 0.05, 0.2)).replace("size", 'contype="2" size')
        + "</worldbody></mujoco>"
    )
    few = find_candidates(model, max_contacts=1)
    xpos = jnp.asarray([[0.0, 0, 0], [0, 0, 0.3], [1, 0, 0.05], [2, 0, 0.2]])
    contacts = detect(model, few, xpos, jnp.tile(jnp.eye(3)[None], (4, 1, 1)))
    assert few.dynamic
    assert isinstance(contacts.geom1, np.ndarray)
    assert (contacts.geom1.tolist(), contacts.geom2.tolist()) == ([0], [2])


def test_deepest_contacts_are_kept_and_the_others_counted(rng):
    model = load(None)
    xpos, xmat = poses(random_data(model, rng, 30, 0.15))
    every, few = find_candidates(model), find_candidates(model, max_contacts=3)

    def both(x, r):
        return detect(model, every, x, r), detect(model, few, x, r)

    everything, kept = jax.device_get(jax.jit(jax.vmap(both))(xpos, xmat))
    dropped = 0
    for block, cut in zip(every.ranges, few.ranges, strict=True):
        excess = (everything.dist - everything.includemargin)[:, block.slots]
        ours = (kept.dist - kept.includemargin)[:, cut.slots]
        deepest = np.sort(np.minimum(excess, 0), axis=1)[:, : ours.shape[1]]
        np.testing.assert_allclose(np.sort(np.minimum(ours, 0), axis=1), deepest, atol=1e-12)
        dropped = dropped + (excess < 0).sum(axis=1) - (deepest < 0).sum(axis=1)
    np.testing.assert_array_equal(kept.overflow, dropped)
    assert (dropped > 0).any()


def test_pairs_that_are_left_out_are_counted_unless_they_are_surely_apart():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody>"
        + "".join(
            f'<body pos="{x} 0 0"><freejoint/><geom size=".1"/></body>' for x in (0, 0.1, 1, 2)
        )
        + "</worldbody></mujoco>"
    )
    candidates = find_candidates(model, max_geom_pairs=1)
    xmat = jnp.tile(jnp.eye(3)[None], (4, 1, 1))

    jitted = jax.jit(lambda xpos: detect(model, candidates, xpos, xmat))

    def contacts_at(*xs):
        return jitted(jnp.asarray([[x, 0.0, 0.0] for x in xs]))

    near = contacts_at(0.0, 0.1, 1.0, 2.0)
    assert (int(near.geom1[0]), int(near.geom2[0]), int(near.overflow)) == (0, 1, 0)
    np.testing.assert_allclose(near.dist, [-0.1])
    far = contacts_at(0.0, 1.0, 2.0, 2.05)
    assert (int(far.geom1[0]), int(far.geom2[0]), int(far.overflow)) == (2, 3, 0)
    assert int(contacts_at(0.0, 0.1, 2.0, 2.05).overflow) == 1


def test_derivatives_flow_through_selection_and_parameters(rng):
    """Both modes agree with differences while the same contacts stay selected."""
    model = load(None)
    [data] = random_data(model, rng, 1, 0.1)
    xpos, xmat = (x[0] for x in poses([data]))
    for candidates in (find_candidates(model), find_candidates(model, max_geom_pairs=2)):

        def depth(x, candidates=candidates):
            contacts = detect(model, candidates, x, xmat)
            penetration = jnp.where(contacts.active, contacts.dist - contacts.includemargin, 0.0)
            return jnp.sum(penetration**2)

        forward, backward = (jax.jit(d(depth))(xpos) for d in (jax.jacfwd, jax.jacrev))
        np.testing.assert_allclose(forward, backward, atol=1e-14)
        assert np.isfinite(forward).all()
        direction = jnp.asarray(rng.normal(size=xpos.shape))
        h, value = 1e-6, jax.jit(depth)
        difference = (value(xpos + h * direction) - value(xpos - h * direction)) / (2 * h)
        np.testing.assert_allclose(jnp.sum(forward * direction), difference, rtol=1e-6, atol=1e-9)
        assert abs(difference) > 1e-3


def test_loops_of_kernels_find_the_same(rng):
    """The deepest contacts, how many are lost, and derivatives; pairs fill a block and more."""
    ball = '<body pos="{} {} 0"><freejoint/><geom type="{}" size=".08 .1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/>'
        + "".join(ball.format(0.2 * (k % 3), 0.2 * (k // 3), "capsule") for k in range(9))
        + '<body pos="0 .1 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>'
        + "</worldbody></mujoco>"
    )
    candidates = find_candidates(model, max_contacts=12)
    datas = random_data(model, rng, 20, 0.1) + random_data(model, rng, 4, 2.0)
    xpos, xmat = poses(datas)

    def found(x, r):
        c = detect(model, candidates, x, r)
        excess = jnp.minimum(c.dist - c.includemargin, 0)
        rows = jnp.concatenate([c.pos, c.frame.reshape(-1, 9), c.geom1[:, None]], axis=1)
        return excess, jnp.where(excess[:, None] < 0, rows, 0.0), c.overflow

    plain = jax.jit(jax.vmap(found))(xpos, xmat)
    looped = jax.jit(jaxsim.vmap(as_kernel(found)))(xpos, xmat)
    np.testing.assert_array_equal(looped[2], plain[2])
    assert 0 < np.mean(plain[2] > 0) < 1
    for span in candidates.ranges:
        orders = [np.argsort(excess[:, span.slots], axis=1) for excess, *_ in (plain, looped)]
        for a, b in zip(plain[:2], looped[:2], strict=True):
            sort = lambda x, o, s=span.slots: np.stack(  # noqa: E731
                [x[i, s][o[i]] for i in range(len(x))]
            )
            np.testing.assert_allclose(sort(b, orders[1]), sort(a, orders[0]), atol=1e-12)

    def depth(f):
        return lambda x: jnp.sum(f(x, xmat[0])[0] ** 2)

    slopes = [jax.jit(jax.grad(depth(f)))(xpos[0]) for f in (found, as_kernel(found))]
    np.testing.assert_allclose(*slopes, atol=1e-14)
    assert np.abs(slopes[0]).max() > 1e-3


def test_selection_has_no_nan_where_all_centres_coincide():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody>"
        + '<body><freejoint/><geom size=".1"/></body>' * 4
        + "</worldbody></mujoco>"
    )
    candidates = find_candidates(model, max_geom_pairs=3, max_contacts=2)
    xmat = jnp.tile(jnp.eye(3)[None], (4, 1, 1))

    def total(x):
        contacts = detect(model, candidates, x, xmat)
        return jnp.sum(contacts.dist), contacts.overflow

    grad, overflow = jax.jit(jax.grad(total, has_aux=True))(jnp.zeros((4, 3)))
    assert np.isfinite(grad).all()
    assert int(overflow) == 6 - 2


def test_no_candidates_gives_empty_contacts():
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom size=".1"/></worldbody></mujoco>'
    )
    candidates = find_candidates(model)
    evaluate = jax.jit(lambda x, r: detect(model, candidates, x, r))
    contacts = evaluate(jnp.zeros((1, 3)), jnp.eye(3)[None])
    assert contacts.dist.shape == (0,)
    assert contacts.frame.shape == (0, 3, 3)
    assert contacts.ranges == ()
    assert contacts.condim.shape == (0,)
