"""Jacobians of points on bodies, geoms and sites, and their rates."""

import jax
import mujoco
import numpy as np
import pytest
from oracle import assert_close, at, quick_jit

from jaxsim.dynamics.jacobian import (
    body_jacobian,
    com_jacobian,
    geom_jacobian,
    jacobian_dot_qvel,
    point_jacobian,
    site_jacobian,
)
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.velocity import velocities

POINT = np.array([0.3, -0.2, 0.5])


@pytest.fixture(scope="session")
def jacobians(scene):
    """Of some bodies, the last geom and the last site, at all states."""

    def compute(model, qpos, qvel):
        kin = kinematics(model, qpos)
        vel = velocities(model, kin, qvel)
        bodies = _bodies(scene)
        return {
            "point": [point_jacobian(model, kin, b, POINT) for b in bodies],
            "dot": [jacobian_dot_qvel(model, kin, vel, b, POINT) for b in bodies],
            "com dot": jacobian_dot_qvel(model, kin, vel, bodies[-1], kin.xipos[bodies[-1]]),
            "body": body_jacobian(model, kin, bodies[-1]),
            "com": com_jacobian(model, kin, bodies[-1]),
            "geom": geom_jacobian(model, kin, model.ngeom - 1),
            "site": site_jacobian(model, kin, model.nsite - 1),
        }

    with jax.enable_x64(True):
        compute = quick_jit(jax.vmap(compute, in_axes=(None, 0, 0)))
        return compute(scene.model, scene.qpos, scene.qvel)


def test_jacobian_of_a_point_is_that_of_mujoco(scene, jacobians):
    for ours, body in zip(jacobians["point"], _bodies(scene), strict=True):
        _compare(scene, ours, lambda d, p, r, b=body: mujoco.mj_jac(scene.mj, d, p, r, POINT, b))


def test_jacobian_of_body_com_geom_and_site_is_that_of_mujoco(scene, jacobians):
    mj, body = scene.mj, _bodies(scene)[-1]
    _compare(scene, jacobians["body"], lambda d, p, r: mujoco.mj_jacBody(mj, d, p, r, body))
    _compare(scene, jacobians["com"], lambda d, p, r: mujoco.mj_jacBodyCom(mj, d, p, r, body))
    _compare(scene, jacobians["geom"], lambda d, p, r: mujoco.mj_jacGeom(mj, d, p, r, mj.ngeom - 1))
    _compare(scene, jacobians["site"], lambda d, p, r: mujoco.mj_jacSite(mj, d, p, r, mj.nsite - 1))


def test_rate_of_the_jacobian_is_that_of_mujoco(scene, jacobians):
    for ours, body in zip(jacobians["dot"], _bodies(scene), strict=True):
        theirs = np.zeros((2, len(scene.qpos), 3))
        for i, data in enumerate(_data(scene)):
            jacp, jacr = np.zeros((2, 3, scene.mj.nv))
            mujoco.mj_jacDot(scene.mj, data, jacp, jacr, POINT, body)
            theirs[:, i] = jacp @ data.qvel, jacr @ data.qvel
        assert_close(ours[0], theirs[0], 1e-11, 1e-11)
        assert_close(ours[1], theirs[1], 1e-11, 1e-11)


def test_jacobians_of_all_bodies_agree_with_those_of_one(scene, jacobians):
    both = scene.jacobians[:, _bodies(scene)[-1]]
    assert_close(both[:, 3:], jacobians["com"][0], 1e-13, 1e-13)
    assert_close(both[:, :3], jacobians["com"][1], 1e-13, 1e-13)


def test_world_does_not_move(jacobians):
    assert not np.any(jacobians["point"][0])
    assert not np.any(jacobians["dot"][0])


def test_rate_of_the_jacobian_is_its_derivative_along_the_motion(scene, jacobians):
    body = _bodies(scene)[-1]
    rate = np.einsum("nij,nj->ni", scene.rate["jacobians"][:, body], scene.qvel)
    assert_close(jacobians["com dot"][0], rate[:, 3:], 1e-11, 1e-11)
    assert_close(jacobians["com dot"][1], rate[:, :3], 1e-11, 1e-11)


@pytest.mark.parametrize(
    ("function", "kind"),
    [(body_jacobian, "body"), (geom_jacobian, "geom"), (site_jacobian, "site")],
)
def test_unknown_numbers_are_named(scene, function, kind):
    for number in (-1, 1000):
        with pytest.raises(IndexError, match=f"{kind}.* {number}"):
            function(scene.model, None, number)


def _bodies(scene) -> list[int]:
    """The world, something welded to it, something welded to a link, a body of each tree."""
    mj = scene.mj
    moving = np.nonzero(mj.body_weldid == np.arange(mj.nbody))[0]
    welded = np.nonzero((mj.body_weldid != np.arange(mj.nbody)) & (mj.body_weldid > 0))[0]
    return [0, 1, int(welded[0]), int(moving[1]), int(moving[-1])]


def _data(scene):
    return [at(scene.mj, q, v) for q, v in zip(scene.qpos, scene.qvel, strict=True)]


def _compare(scene, ours, theirs):
    expected = np.zeros((len(scene.qpos), 2, 3, scene.mj.nv))
    for data, (jacp, jacr) in zip(_data(scene), expected, strict=True):
        theirs(data, jacp, jacr)
    assert_close(ours[0], expected[:, 0], 1e-12, 1e-12)
    assert_close(ours[1], expected[:, 1], 1e-12, 1e-12)
