"""`forward_details` agrees with what MuJoCo keeps in its data."""

import jax
import mujoco
import numpy as np
from instants import batch_states, converging
from mujoco_records import rollout
from oracle import quick_jit

import jaxsim

BODIES = (
    "xanchor xaxis ximat cam_xpos cam_xmat cinert crb cdof cdof_dot cvel cacc cfrc_int cfrc_ext "
    "subtree_linvel subtree_angmom ten_length ten_velocity ten_J actuator_moment "
    "qfrc_spring qfrc_damper qfrc_gravcomp qfrc_fluid"
).split()
ROWS = (
    "efc_type efc_J efc_pos efc_margin efc_frictionloss efc_D efc_vel efc_aref efc_force"
).split()

XML = """
<mujoco><compiler angle="radian"/>
<option timestep=".002" gravity="0 .5 -9" density="20" viscosity=".01"/><worldbody>
  <camera name="corner" pos="2 1 1" mode="targetbody" target="tip"/>
  <geom type="plane" size="5 5 1" condim="1"/>
  <body pos="0 0 .09"><freejoint/><geom size=".1" condim="4" friction=".7 .1 .05"/>
    <body pos=".1 0 .1" euler="0 .3 0" gravcomp=".5"><camera pos="0 .1 0" euler="1 0 .2"/>
      <joint name="slide" type="slide" axis="1 0 1" frictionloss=".2" stiffness="3"/>
      <joint name="hinge" axis="0 1 .3" pos=".1 0 .1" range=".05 1" margin=".02" limited="true"
        damping=".1"/>
      <geom type="capsule" size=".04" fromto="0 0 0 .1 .2 .3" contype="0" conaffinity="0"/>
      <body name="tip" pos=".1 .2 .3"><joint name="other" axis="1 0 .2"/>
        <geom size=".06" contype="0" conaffinity="0"/></body>
    </body>
  </body>
  <body pos="1 0 .045" euler="0 0 .3"><freejoint/><geom type="capsule" size=".05 .1"
    euler="0 1.571 0" condim="1"/></body>
  <body name="lamp" pos="-1 0 1"><joint type="ball" range="0 .2" limited="true"/>
    <geom size=".05" pos="0 .1 .1"/></body>
</worldbody>
<tendon><fixed name="rope" frictionloss=".1" range="-.01 .01" limited="true">
  <joint joint="hinge" coef="1"/><joint joint="other" coef="-.5"/></fixed></tendon>
<equality>
  <joint joint1="other" joint2="slide" polycoef="0 .5 .1 0 0"/>
  <weld body1="tip" relpose="0 0 0 1 0 0 0" torquescale="2"/>
  <tendon tendon1="rope"/>
  <connect body1="lamp" anchor="0 .2 0"/>
</equality>
<actuator><motor joint="hinge" gear="2"/><position tendon="rope" kp="3"/></actuator></mujoco>
"""


BALL = """
<mujoco><option cone="elliptic" impratio="2"/><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 .09"><freejoint/><geom size=".1" condim="6" friction=".7 .1 .05"/></body>
</worldbody></mujoco>
"""


def test_agrees_with_mujoco(x64):
    types = compare(XML) | compare(BALL)
    assert types == {int(t) for t in mujoco.mjtConstraint.__members__.values()}


def compare(xml) -> set[int]:
    """Compare everything at two instants; the types of the rows that were active."""
    mj = converging(xml)
    mj.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    model, datas = jaxsim.load(mj), rollout(mj, count=2, every=6)
    evaluate = quick_jit(jax.vmap(lambda *at: jaxsim.forward_details(model, *at)))
    found = evaluate(*batch_states(model, datas))
    for i, data in enumerate(datas):
        mine = jax.tree.map(lambda x, i=i: np.asarray(x)[i], found)
        for name in BODIES:
            assert_near(getattr(mine, name), dense(mj, data, name), name)
        assert_rows(mj, data, mine)
    return set(np.concatenate([d.efc_type for d in datas]).tolist())


def assert_rows(mj, data, mine):
    """The active rows are those that MuJoCo lists, in its order up to that of the contacts."""
    rows = np.nonzero(mine.efc_D > 0)[0]
    contact = mine.efc_type[rows] >= int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)
    slots = [np.linalg.norm(mine.contact.pos - c.pos, axis=1).argmin() for c in data.contact]
    parts = [rows[contact & (mine.efc_id[rows] == slot)] for slot in slots]
    order = np.concatenate([rows[~contact], *parts])
    ids = np.concatenate(
        [mine.efc_id[rows[~contact]], *(np.full(len(p), i) for i, p in enumerate(parts))]
    )
    assert_near(ids, data.efc_id, "efc_id")
    for name in ROWS:
        assert_near(getattr(mine, name)[order], getattr(data, name), name)
    idle = mine.efc_D == 0
    np.testing.assert_array_equal(mine.efc_J[idle], 0)
    np.testing.assert_array_equal(mine.efc_force[idle], 0)
    np.testing.assert_allclose(mine.efc_J.T @ mine.efc_force, mine.qfrc_constraint, atol=1e-9)


def assert_near(actual, expected, name):
    error = np.abs(actual - expected.reshape(actual.shape)).max(initial=0)
    assert error < 1e-7 * (1 + np.abs(expected).max(initial=0)), name


def dense(mj, data, name):
    """A field of the data, as a matrix if MuJoCo stores it sparse."""
    if name == "actuator_moment":
        rows, owner, prefix = mj.nu, data, "moment"
    elif name == "ten_J":
        rows, owner, prefix = mj.ntendon, mj, "ten_J"
    else:
        return getattr(data, name)
    where = [getattr(owner, f"{prefix}_{part}") for part in ("rownnz", "rowadr", "colind")]
    full = np.zeros((rows, mj.nv))
    mujoco.mju_sparse2dense(full, np.ravel(getattr(data, name)), *where)
    return full
