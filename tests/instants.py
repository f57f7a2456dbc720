"""States of a MuJoCo rollout as one batch, and agreement of `forward` with MuJoCo at each."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import assert_close, quick_jit

from jaxsim.engine.report import forward
from jaxsim.model import make_state
from jaxsim.model.history import history_of

CONES = {"pyramidal": mujoco.mjtCone.mjCONE_PYRAMIDAL, "elliptic": mujoco.mjtCone.mjCONE_ELLIPTIC}


@dataclasses.dataclass(frozen=True)
class Tolerances:
    """Of `(atol, rtol)`: forces and accelerations, contact geometry, the objective, a step."""

    solution: tuple[float, float]
    smooth: tuple[float, float]
    contact: float
    cost: float
    step: float


DOUBLE = Tolerances((1e-6, 1e-6), (1e-9, 1e-9), 1e-10, 1e-9, 1e-8)
SINGLE = Tolerances((1e-1, 1e-2), (1e-2, 1e-3), 1e-5, 1e-4, 1e-4)


def converging(source, cone: str | None = None, **options) -> mujoco.MjModel:
    """A compiled model whose solver goes on until it converges."""
    if isinstance(source, mujoco.MjModel):
        mj = source
    elif source.lstrip().startswith("<"):
        mj = mujoco.MjModel.from_xml_string(source)
    else:
        mj = mujoco.MjModel.from_xml_path(source)
    mj.opt.solver = mujoco.mjtSolver.mjSOL_NEWTON
    mj.opt.iterations, mj.opt.ls_iterations, mj.opt.tolerance = 100, 50, 0
    if cone:
        mj.opt.cone = CONES[cone]
    for name, value in options.items():
        setattr(mj.opt, name, value)
    return mj


def rollout(mj, count: int, every: int, seed: int = 0, spread: float = 0.3, key=None):
    """Data before the next step, at several instants of a rollout with random controls."""
    rng = np.random.default_rng(seed)
    data, found = mujoco.MjData(mj), []
    if key is not None:
        mujoco.mj_resetDataKeyframe(mj, data, key)
    data.qvel[:] += spread * rng.normal(size=mj.nv)
    for _ in range(count):
        limited = mj.actuator_ctrllimited.astype(bool)[:, None]
        low, high = np.where(limited, mj.actuator_ctrlrange, [-1.0, 1.0]).T
        data.ctrl[:] = rng.uniform(low, high)
        found.append(evaluated(mj, data))
        for _ in range(every):
            mujoco.mj_step(mj, data)
    return found


def evaluated(mj, data) -> mujoco.MjData:
    """A copy of the data with everything at its instant computed."""
    other = mujoco.MjData(mj)
    mujoco.mj_copyData(other, mj, data)
    mujoco.mj_forward(mj, other)
    return other


def stepped(mj, data, integrator=None) -> mujoco.MjData:
    """A copy of the data one step later."""
    other = mujoco.MjData(mj)
    mujoco.mj_copyData(other, mj, data)
    if integrator is not None:
        mj.opt.integrator = integrator
    mujoco.mj_step(mj, other)
    return other


def batch_states(model, datas):
    """The states of several data as one batch, and their controls."""
    one = make_state(model)
    dtype = one.qpos.dtype
    batch = {}
    for name in vars(one).keys() - {"time_excess", "history"}:
        values = np.stack([np.asarray(getattr(d, name)) for d in datas])
        batch[name] = jnp.asarray(values.reshape(len(datas), *getattr(one, name).shape), dtype)
    # A cold start: the warm start must not matter.
    batch["qacc_warmstart"] = jnp.zeros_like(batch["qvel"])
    if model.nhistory:
        batch["history"] = jnp.stack([history_of(model, d.history, d.time) for d in datas])
    return one.replace(**batch), jnp.asarray(np.stack([d.ctrl for d in datas]), dtype)


def forward_all(model, datas):
    """`forward` at the state of each of the data."""
    return quick_jit(jax.vmap(forward, (None, 0, 0)))(model, *batch_states(model, datas))


def assert_instants(mj, datas, out, tolerance: Tolerances = DOUBLE) -> None:
    """What `forward` found agrees with MuJoCo at every instant."""
    assert np.isfinite(out.qacc).all()
    assert int(np.max(out.status.contact_overflow)) == 0
    for name in ("qacc", "qfrc_constraint"):
        _compare(name, out, datas, tolerance.solution)
    _compare("qacc_smooth", out, datas, tolerance.smooth)
    for i, data in enumerate(datas):
        mine = jax.tree.map(lambda x, i=i: np.asarray(x)[i], out)
        assert_contacts(mj, data, mine.contact, tolerance)
        best, ours = objective(mj, data, data.qacc), objective(mj, data, mine.qacc)
        assert ours <= best * (1 + tolerance.cost) + tolerance.cost
        assert abs(mine.cost - best) <= max(1e-6, tolerance.cost) * (1 + abs(best))
        if mj.nsensordata:
            rtol = tolerance.solution[1]
            np.testing.assert_allclose(
                mine.sensordata,
                data.sensordata,
                atol=tolerance.solution[0] + rtol * np.abs(data.sensordata).max(),
                rtol=rtol,
            )


def _compare(name, out, datas, tolerance):
    expected = np.stack([getattr(d, name) for d in datas])
    assert_close(getattr(out, name), expected, *tolerance, what=name)


def objective(mj, data, qacc) -> float:
    """MuJoCo's objective at an acceleration."""
    qacc = np.asarray(qacc, float)
    other = evaluated(mj, data)
    momentum = np.zeros(mj.nv)
    mujoco.mj_mulM(mj, other, momentum, qacc)
    gauss = 0.5 * (momentum - other.qfrc_smooth) @ (qacc - other.qacc_smooth)
    if not other.nefc:
        return gauss
    jar, cost = np.zeros(other.nefc), np.zeros(1)
    mujoco.mj_mulJacVec(mj, other, jar, qacc)
    mujoco.mj_constraintUpdate(mj, other, jar - other.efc_aref, cost, 0)
    return gauss + cost[0]


def assert_contacts(mj, data, contact, tolerance: Tolerances) -> None:
    """Active contacts agree, matched by geoms and position, whatever their order."""
    theirs = [i for i in range(data.ncon) if data.contact.efc_address[i] >= 0]
    left = list(np.nonzero(contact.active)[0])
    assert len(left) == len(theirs)
    force = np.zeros(6)
    for i in theirs:
        c = data.contact[i]
        same = [j for j in left if {contact.geom1[j], contact.geom2[j]} == set(c.geom)]
        assert same, f"no contact of geoms {c.geom}"
        j = min(same, key=lambda j: np.linalg.norm(contact.pos[j] - c.pos))
        left.remove(j)
        assert (contact.geom1[j], contact.geom2[j]) == tuple(c.geom)
        np.testing.assert_allclose(contact.dist[j], c.dist, atol=tolerance.contact)
        np.testing.assert_allclose(contact.pos[j], c.pos, atol=tolerance.contact * 10)
        np.testing.assert_allclose(contact.frame[j].ravel(), c.frame, atol=tolerance.contact * 10)
        mujoco.mj_contactForce(mj, data, i, force)
        atol, rtol = tolerance.solution
        total = np.linalg.norm(data.efc_force)
        np.testing.assert_allclose(contact.force[j], force, atol=atol + rtol * total)
