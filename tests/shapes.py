"""Shape annotations, checked while jaxsim runs.

`install()`, called before jaxsim is imported, makes every function of the package check the shapes
and dtypes that it is annotated with. This doubles the time to import and adds a third to tracing,
so that only `main` does it and not every test.
"""

import typing
from collections.abc import Callable

import beartype
import jaxtyping


def install() -> None:
    """Check the annotations of what is imported from now on."""
    jaxtyping.install_import_hook("jaxsim", "shapes.checked")


def checked(function: Callable) -> Callable:
    """A function that checks its arguments and result, of which only arrays are looked at.

    Records are not checked where they are made, as batches of them have one axis more.
    """
    arrays = {k: v for k, v in function.__annotations__.items() if _of_arrays(v)}
    if not arrays or function.__name__ == "__init__" or "<locals>" in function.__qualname__:
        return function
    function.__annotations__ = {
        name: arrays.get(name, typing.Any) for name in function.__annotations__
    }
    return beartype.beartype(function)


def _of_arrays(annotation) -> bool:
    if isinstance(annotation, type) and issubclass(annotation, jaxtyping.AbstractArray):
        return True
    return any(map(_of_arrays, typing.get_args(annotation)))


SENSORS = """
<mujoco>
  <worldbody>
    <geom type="plane" size="5 5 .1"/>
    <body name="arm" pos="0 0 .2"><joint name="ball" type="ball" range="0 30" limited="true"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".05"/>
      <site name="tip" pos=".3 0 0" size=".1"/>
      <body name="hand" pos=".4 0 0"><joint name="hinge" range="-20 40" limited="true"/>
        <geom size=".1"/><site name="in"/></body>
    </body>
  </worldbody>
  <tendon><fixed name="cord" limited="true" range="-1 1"><joint joint="hinge" coef="2"/></fixed>
  </tendon>
  <actuator><motor name="push" joint="hinge"/><muscle name="pull" tendon="cord"/></actuator>
  <sensor>
    <magnetometer site="tip"/><velocimeter site="tip"/><gyro site="tip"/><accelerometer site="tip"/>
    <force site="in"/><torque site="in"/><touch site="tip"/><jointpos joint="hinge"/>
    <jointvel joint="hinge"/><jointactuatorfrc joint="hinge"/><ballquat joint="ball"/>
    <ballangvel joint="ball"/><jointlimitpos joint="ball"/><jointlimitvel joint="hinge"/>
    <jointlimitfrc joint="hinge"/><tendonpos tendon="cord"/><tendonvel tendon="cord"/>
    <tendonactuatorfrc tendon="cord"/><tendonlimitpos tendon="cord"/><tendonlimitvel tendon="cord"/>
    <tendonlimitfrc tendon="cord"/><actuatorpos actuator="push"/><actuatorvel actuator="pull"/>
    <actuatorfrc actuator="pull"/><framequat objtype="body" objname="hand"/>
    <framexaxis objtype="site" objname="in"/>
    <framelinvel objtype="body" objname="hand" reftype="site" refname="tip"/>
    <frameangvel objtype="body" objname="hand"/><framelinacc objtype="site" objname="in"/>
    <frameangacc objtype="body" objname="hand"/><subtreecom body="arm"/><subtreelinvel body="arm"/>
    <subtreeangmom body="arm"/><insidesite objtype="body" objname="hand" site="tip"/>
    <e_potential/><e_kinetic/><clock/>
    <framepos objtype="site" objname="tip" reftype="body" refname="arm"/>
  </sensor>
</mujoco>
"""


def main() -> None:
    """Trace what the package offers, with something of everything in the models."""
    import jax
    import mujoco
    from random_models import CONSTRAINED, Features, random_model

    import jaxsim

    jax.config.update("jax_numpy_rank_promotion", "raise")
    smooth = Features(bodies=4, gravcomp=True, fluid=True, poly=True, mocap=True)
    smooth, sensors = map(jaxsim.load, (random_model(0, smooth), SENSORS))
    mj = mujoco.MjModel.from_xml_string(random_model(1, CONSTRAINED, bodies=3, self_collision=True))
    mj.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    constrained = jaxsim.load(mj)
    for model in smooth, sensors, constrained:
        _trace_instant(model)
    for integrator in range(4):
        _trace_steps(sensors.replace(opt=sensors.opt.replace(integrator=integrator)))
    _trace_steps(jaxsim.load("half_cheetah"))  # all of it moves in one plane
    _trace_batch(jaxsim.load("cartpole"))
    _trace_environment("reacher")
    _fails_where_it_should()


def _trace_instant(model) -> None:
    import jax
    import jax.numpy as jnp

    import jaxsim

    state = jaxsim.make_state(model)
    jax.eval_shape(lambda s: jaxsim.forward(model, s, jnp.zeros(model.nu)), state)
    jax.eval_shape(lambda s: jaxsim.inverse(model, s, s.qvel), state)
    jax.eval_shape(jaxsim.set_const, model)
    jax.eval_shape(lambda q: jaxsim.mass_matrix(model, q), state.qpos)
    for dynamics in jaxsim.inverse_dynamics, jaxsim.forward_dynamics:
        jax.eval_shape(lambda s, f=dynamics: f(model, s.qpos, s.qvel, s.qvel), state)


def _trace_steps(model) -> None:
    import jax
    import jax.numpy as jnp

    import jaxsim

    ctrls = jnp.zeros((2, model.nu))
    jax.eval_shape(lambda s: jaxsim.rollout(model, s, ctrls), jaxsim.make_state(model))


def _trace_batch(model) -> None:
    import jax
    import jax.numpy as jnp

    import jaxsim

    states = jax.tree.map(lambda x: jnp.stack([x, x]), jaxsim.make_state(model))
    batch = lambda u: jaxsim.batch_rollout(model, states, u).qpos.sum()  # noqa: E731
    jax.eval_shape(jax.grad(batch), jnp.zeros((2, 2, model.nu)))


def _trace_environment(name: str) -> None:
    import jax
    import jax.numpy as jnp

    from jaxsim.envs import make

    env = make(name)
    jax.eval_shape(lambda k: env.step(env.reset(k), jnp.zeros(env.action_size)), jax.random.key(0))


def _fails_where_it_should() -> None:
    """The checks are on: positions of another size than the model's are found."""
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load("box_on_plane")
    velocity = jnp.zeros(model.nv)
    try:
        jaxsim.inverse_dynamics(model, jnp.zeros(model.nq), velocity, velocity[:-1])
    except jaxtyping.TypeCheckError:
        return
    raise AssertionError("a wrong shape passed")


if __name__ == "__main__":
    install()
    main()
