"""Height fields: prisms as MuJoCo's."""

import jax
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision import detect, model_candidates

HEIGHTS = " ".join(f"{x:.3f}" for x in np.random.default_rng(0).random(63))
SCENE = """<mujoco><asset><hfield name="hills" nrow="7" ncol="9" size="1 .6 .2 .2"
  elevation="{heights}"/></asset><worldbody>
  <geom type="hfield" hfield="hills" pos="0 0 .1" euler="10 0 20"/>
  <body><freejoint/><geom {geom}/></body></worldbody></mujoco>"""


def random_scenes(geom, rng, count=60):
    mj = mujoco.MjModel.from_xml_string(SCENE.format(heights=HEIGHTS, geom=geom))
    data, scenes = mujoco.MjData(mj), []
    for _ in range(count):
        quat = rng.normal(size=4)
        pos = [rng.uniform(-1, 1), rng.uniform(-0.6, 0.6), rng.uniform(0.15, 0.45)]
        data.qpos[:] = [*pos, *quat / np.linalg.norm(quat)]
        mujoco.mj_fwdPosition(mj, data)
        pose = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        scenes.append((*pose, data.contact.dist.copy()))
    return mj, scenes


@pytest.mark.parametrize(
    ("geom", "same_depth"),
    [
        ('type="sphere" size=".12"', True),
        # MuJoCo's depth of flat solids in a prism is not the least one.
        pytest.param('type="box" size=".08 .1 .12"', False, marks=pytest.mark.slow),
    ],
    ids=["sphere", "box"],
)
def test_contacts_are_mujocos(geom, same_depth, rng, x64):
    """As many, and as deep; beyond the border, too."""
    mj, scenes = random_scenes(geom, rng)
    model = jaxsim.load(mj)
    candidates = model_candidates(model)
    found = quick_jit(jaxsim.vmap(lambda x, r: detect(model, candidates, x, r).dist))
    pos, mat = (np.array([s[k] for s in scenes]) for k in range(2))
    double, single = (
        np.asarray(jax.device_get(found(pos.astype(t), mat.astype(t)))) for t in ("d", "f")
    )
    near = np.abs(double) < 0.01
    np.testing.assert_allclose(single[near], double[near], atol=1e-6)
    touched = 0
    for dist, (_, _, expected) in zip(double, scenes, strict=True):
        ours, expected = np.sort(dist[dist < 0]), np.sort(expected)[:8]
        assert len(ours) == len(expected)
        touched += len(expected) > 0
        if same_depth:
            np.testing.assert_allclose(ours, expected, atol=1e-6)
        else:
            assert (ours < expected + 1e-6).all()
    assert 10 < touched < 55


def test_what_finds_no_slot_is_counted(x64):
    """A box on more triangles than a pair has slots; a box beyond the cells that are tested."""
    level = SCENE.format(heights=" ".join(["1"] * 63), geom='type="box" size=".23 .27 .1"')
    mj = mujoco.MjModel.from_xml_string(level.replace("10 0 20", "0 0 0"))
    model, data = jaxsim.load(mj), mujoco.MjData(mj)
    candidates = model_candidates(model)
    data.qpos[:3] = 0.03, 0.02, 0.19
    mujoco.mj_fwdPosition(mj, data)
    pos, mat = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()

    def overflow(height, size):
        raised = pos + height * np.array([[0, 0, 0], [0, 0, 1]])
        return detect(model.replace(geom_size=size), candidates, raised, mat).overflow

    count = quick_jit(overflow)
    assert count(0.0, model.geom_size) == data.ncon - 8 > 0
    assert count(0.1, model.geom_size) == 0
    assert count(1.0, 3 * model.geom_size) > 0
