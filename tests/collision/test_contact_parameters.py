"""Mixing of contact parameters against MuJoCo's contact structs, and its derivatives."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxsim.collision.parameters import (
    Surface,
    contact_margin,
    contact_parameters,
    mix,
    mixing_weight,
)

FIELDS = ("includemargin", "friction", "solref", "solreffriction", "solimp")


@pytest.fixture
def random_spheres(rng):
    """Twelve overlapping spheres with random contact parameters, some of them in explicit pairs."""
    bodies = "".join(
        f'<body pos="{0.01 * i} 0 0"><freejoint/><geom name="g{i}" size="1"/></body>'
        for i in range(12)
    )
    pairs = "".join(f'<pair geom1="g{i}" geom2="g{i + 1}"/>' for i in (0, 3, 6, 9))
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{bodies}</worldbody><contact>{pairs}</contact></mujoco>"
    )
    n, k = model.ngeom, model.npair
    model.geom_priority[:] = rng.integers(-1, 2, n)
    model.geom_solmix[:] = rng.choice([0.0, 1e-16, 0.5, 1.0, 3.0], n)
    model.geom_friction[:] = rng.choice([0.0, 1e-7, 0.3, 1.2], (n, 3))
    standard, direct = rng.uniform(0.01, 1, (n, 2)), -rng.uniform(10, 100, (n, 2))
    model.geom_solref[:] = np.where(rng.random((n, 1)) < 0.7, standard, direct)
    model.geom_solimp[:] = rng.uniform(0.1, 0.9, (n, 5))
    model.geom_margin[:] = rng.uniform(0, 0.1, n)
    model.geom_gap[:] = rng.uniform(0, 0.1, n)
    model.pair_friction[:] = rng.choice([0.0, 0.4, 1.0], (k, 5))
    model.pair_solref[:] = rng.uniform(0.01, 1, (k, 2))
    model.pair_solreffriction[:2] = rng.uniform(0.01, 1, (2, 2))
    model.pair_solimp[:] = rng.uniform(0.1, 0.9, (k, 5))
    model.pair_margin[:] = rng.uniform(0, 0.1, k)
    return model


def mujoco_contacts(model):
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    return data.contact


def pair_of(model, geoms):
    ends = np.sort(np.stack([model.pair_geom1, model.pair_geom2], axis=1), axis=1)
    found = np.nonzero((ends == np.sort(geoms)).all(axis=1))[0]
    return found[0] if len(found) else -1


@pytest.mark.parametrize("override", [False, True])
@pytest.mark.parametrize("static", [True, False])
def test_agrees_with_mujoco(random_spheres, override, static):
    model = random_spheres
    if override:
        model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
        model.opt.o_margin, model.opt.o_friction[:] = 0.04, [0.3, 0, 0.1, 0, 2]
        model.opt.o_solref[:], model.opt.o_solimp[:] = [0.1, 0.7], [0.1, 0.2, 0.3, 0.4, 0.5]
    contacts = mujoco_contacts(model)
    pair = np.array([pair_of(model, c.geom) for c in contacts])
    ids = (np.array(contacts.geom)[:, 0], np.array(contacts.geom)[:, 1], pair)
    assert len(pair) == 66
    assert (pair >= 0).sum() == 4
    if static:
        ours = jax.jit(lambda: contact_parameters(model, *ids))()
    else:
        ours = jax.jit(lambda *ids: contact_parameters(model, *ids))(*map(jnp.asarray, ids))
    for name in FIELDS:
        theirs = np.stack([np.asarray(getattr(c, name)) for c in contacts])
        np.testing.assert_allclose(getattr(ours, name), theirs, rtol=1e-14, err_msg=name)


def test_gap_lists_contacts_but_does_not_activate_them(contacts_of):
    """Contacts between margin and margin + gap are listed by MuJoCo 3.17 and excluded."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <geom type="plane" size="1 1 1" margin=".1" gap=".2"/>
      <body><freejoint/><geom size=".1"/></body></worldbody></mujoco>""")
    for height, exclude in ((0.15, 0), (0.25, 1)):
        data = contacts_of(model, [0, 0, height, 1, 0, 0, 0])
        contact, ids = data.contact[0], np.array([[0], [1], [-1]])
        assert contact_margin(model, *ids)[0] == contact.includemargin == 0.1
        assert contact.exclude == exclude == (contact.dist >= contact.includemargin)


def surface(solmix=1.0, solref=(0.02, 1.0), friction=(1.0, 0.1, 0.01), priority=0):
    return Surface(
        friction=jnp.asarray(friction),
        solref=jnp.asarray(solref),
        solimp=jnp.asarray([0.9, 0.95, 0.001, 0.5, 2.0]),
        solmix=jnp.asarray(solmix),
        priority=jnp.asarray(priority),
    )


def test_mixing_by_hand():
    jitted = jax.jit(mix)
    friction, solref, _ = jitted(
        surface(1.0, (0.1, 1.0)), surface(3.0, (0.5, 1.0), (0.5, 0.2, 0.01))
    )
    np.testing.assert_allclose(solref, [0.4, 1.0])
    np.testing.assert_allclose(friction, [1.0, 0.2, 0.01])
    _, solref, _ = jitted(surface(1.0, (0.1, 1.0)), surface(3.0, (-100.0, -5.0)))
    np.testing.assert_allclose(solref, [-100.0, -5.0])


@pytest.mark.parametrize("mixes", [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (0.5, 2.0)])
def test_derivatives_are_finite_without_solmix(mixes):
    weight = mixing_weight(*map(jnp.asarray, mixes))
    expected = {(0.0, 0.0): 0.5, (0.0, 1.0): 0.0, (1.0, 0.0): 1.0, (0.5, 2.0): 0.2}
    np.testing.assert_allclose(weight, expected[mixes])
    for jacobian in (jax.jacfwd, jax.jacrev):
        grads = jax.jit(jacobian(mixing_weight, (0, 1)))(*map(jnp.asarray, mixes))
        assert np.isfinite(grads).all()


def test_parameters_are_differentiable_with_respect_to_the_model():
    def total(solref):
        one = surface(1.0).replace(solref=solref)
        return mix(one, surface(3.0))[1].sum()

    np.testing.assert_allclose(jax.grad(total)(jnp.asarray([0.02, 1.0])), [0.25, 0.25])
