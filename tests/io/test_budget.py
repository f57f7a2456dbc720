"""Budgets of contacts: found by probing, enough for what happens later."""

import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.collision import find_candidates, model_candidates
from jaxsim.io.budget import probe

SHEET = """
<mujoco model="a sheet of 81 spheres, dropped from 1 m">
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body pos="-.4 -.4 1.05">
      <freejoint/>
      <replicate count="9" offset=".1 0 0">
        <replicate count="9" offset="0 .1 0"><geom type="sphere" size=".05"/></replicate>
      </replicate>
    </body>
  </worldbody>
</mujoco>
"""


def test_what_falls_for_a_while_keeps_all_contacts():
    model = jaxsim.load(SHEET)
    assert find_candidates(model, model.max_geom_pairs, model.max_contacts).ncon == 81


@pytest.mark.parametrize("name", ["humanoid", "humanoid_standup"])
def test_four_seconds_of_random_motion_fit(name):
    """States, seeds and controls are others than those of the probes."""
    mj = mujoco.MjModel.from_xml_string(jaxsim.io.bundled_xml(name))
    model = jaxsim.load(mj)
    limits = find_candidates(model, model.max_geom_pairs, model.max_contacts)
    slots = dict(zip(limits.by_kind(), limits.slots(), strict=True))
    rng, data = np.random.default_rng(99), mujoco.MjData(mj)
    for k in range(int(4 / mj.opt.timestep)):
        if k % 20 == 0:
            data.ctrl[:] = rng.uniform(*mj.actuator_ctrlrange.T)
        mujoco.mj_step(mj, data)
        for kind, most in slots.items():
            fixed = data.contact.geom[:, 0] == 0
            mine = (data.contact.dim == kind.condim) & (fixed != kind.movable[0])
            assert mine.sum() <= most


def test_bounding_volumes_that_overlap_have_slots():
    """Discs in layers 5 cm apart never touch, but many of their bounding volumes overlap."""
    discs = "".join(
        f'<body pos="{0.4 * (i % 2)} 0 {0.05 * i}"><joint type="slide"/>'
        '<geom type="ellipsoid" size=".5 .5 .01"/></body>'
        for i in range(30)
    )
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{discs}</worldbody></mujoco>'
    model = jaxsim.load(xml)
    candidates = model_candidates(model)
    assert candidates.pairs()[0] < len(candidates.groups[0])
    assert int(jaxsim.forward(model, jaxsim.make_state(model)).status.contact_overflow) == 0


def test_probing_large_scenes_is_bounded():
    """A hundred bodies take no more steps in all than a few."""
    xml = "".join(f'<body pos="0 0 {i}"><freejoint/><geom size=".1"/></body>' for i in range(100))
    mj = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{xml}</worldbody></mujoco>")
    steps = []
    mujoco.set_mjcb_control(lambda *_: steps.append(1))
    try:
        probe(mj, list(find_candidates(mj).by_kind()))
    finally:
        mujoco.set_mjcb_control(None)
    assert len(steps) * mj.nv <= 1_000_000
