"""Plots show the numbers they are given, and those of the simulation."""

import jax
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim import viz

BALL = """
<mujoco>
  <worldbody>
    <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .3"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="2"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def fall():
    """A ball that falls, meets the floor and comes to rest, and its model."""
    model = jaxsim.load(BALL)
    source, state = jaxsim.to_mujoco(model), jaxsim.make_state(model)
    data, states = mujoco.MjData(source), []
    for _ in range(400):
        mujoco.mj_step(source, data)
        now = {name: np.array(getattr(data, name), np.float32) for name in ("qpos", "qvel")}
        states.append(state.replace(time=np.float32(data.time), time_excess=None, **now))
    return model, jax.tree.map(lambda *x: np.stack(x), *states)


def test_energy_is_kept_until_the_floor(fall):
    picture = viz.plot_energy(*fall)
    lines = {line.get_label(): line.get_ydata() for line in picture.axes[0].lines}
    np.testing.assert_allclose(lines["total"][:90], 0, atol=2e-2 * lines["kinetic"][89])
    assert lines["potential"][-1] < -2 * 9.81 * 0.19
    assert picture._repr_png_()[1:4] == b"PNG"


def test_contact_forces_end_at_the_weight(fall, tmp_path):
    """Also after the simulation was in a file, which has MuJoCo's model."""
    fall = viz.load_trajectory(viz.save_trajectory(tmp_path / "fall", *fall))
    force, count = (axes.lines[0].get_ydata() for axes in viz.plot_contact_forces(*fall).axes)
    assert force[0] == count[0] == 0
    assert force[-1] == pytest.approx(2 * 9.81, rel=1e-2)
    assert count[-1] == 1


def test_quantities_are_drawn_against_time(fall, tmp_path):
    _, trajectory = fall
    twice = np.stack([trajectory.time, 2 * trajectory.time], axis=1)
    picture = viz.plot_trajectory(trajectory, {"t": trajectory.time, "two": twice})
    assert [len(axes.lines) for axes in picture.axes] == [1, 2]
    np.testing.assert_array_equal(picture.axes[1].lines[1].get_ydata(), twice[:, 1])
    assert len(viz.plot_trajectory(trajectory).axes) == 2
    assert picture.save(tmp_path / "a.png").stat().st_size > 1000
    with pytest.raises(ValueError, match=r"quantities\['x'\] must have shape \(400,\)"):
        viz.plot_trajectory(trajectory, {"x": np.zeros(3)})


def test_slopes_stand_beside_differences():
    x = np.linspace(0, 1, 11)
    axes = viz.plot_gradient(x, x**2, {"exact": 2 * x}).axes
    differences, exact = (line.get_ydata() for line in axes[1].lines)
    np.testing.assert_allclose(differences[1:-1], exact[1:-1])
