"""Model-predictive control against the clock: one iteration of iLQR for each control.

Swing-ups begin from a plan and go on for half of its horizon after its end; the quadruped trots
from its stand. A finger that turns a wheel makes two iterations of `InverseDynamics` in float64, of
a wheel that is heavier and more slippery than in its plan. `real time`: whether 95 of 100 controls
are ready within their interval.
"""

import time

import common
import numpy as np


def main(arguments=None) -> None:
    options = common.parser(__doc__, repetitions=1).parse_args(arguments)
    common.setup(devices=2)
    rows = [_swing_up("cartpole"), _swing_up("acrobot"), _quadruped(), _spin()]
    print(common.table(rows), flush=True)
    common.write(options, __file__, {"rows": rows})


def _swing_up(name: str) -> dict:
    import jax

    from jaxsim import trajopt
    from jaxsim.trajopt.tasks import TASKS

    task = TASKS[name]
    problem = task.make()
    plan = trajopt.solve(problem, task.method, key=jax.random.key(0), starts=task.starts)
    steps = problem.horizon * 3 // 2
    row, state = _controlled(name, problem, plan.ctrls, steps)
    return row | {"end": f"tilt {float(task.miss(problem.space.model, state)):.3f} rad"}


def _spin() -> dict:
    import jax
    import jax.numpy as jnp

    import jaxsim
    from jaxsim.trajopt.tasks import TASKS

    with jax.enable_x64(True):
        task = TASKS["spin"]
        problem = task.make()
        model = problem.space.model
        heavier = jnp.ones(model.nbody).at[3].set(1.3)
        plant = model.replace(
            geom_friction=0.7 * model.geom_friction,
            dof_damping=model.dof_damping.at[2].mul(1.5),
            body_mass=heavier * model.body_mass,
            body_inertia=heavier[:, None] * model.body_inertia,
        )
        ctrls = jnp.zeros((problem.horizon, model.nu))
        step = lambda x, u: jaxsim.step(plant, x, u)  # noqa: E731
        row, state = _controlled(
            "spin", problem, ctrls, 160, task.method, first=160, iterations=2, plant=step
        )
        return row | {"end": f"{float(state.qpos[2]):.2f} of 2 rad"}


def _quadruped() -> dict:
    import jax

    problem = _trot()
    ctrls = problem.random_ctrls(jax.random.key(0))
    row, state = _controlled("quadruped", problem, ctrls, 150)
    return row | {"end": f"{float(state.qpos[0]):.2f} m in {float(state.time):.1f} s"}


def _trot():
    """A robot dog that shall go 0.5 m/s, and lift diagonal legs in turn every 0.4 s."""
    import jax.numpy as jnp

    import jaxsim
    from jaxsim import trajopt

    model = jaxsim.load("quadruped")

    def pose(time):
        swing = jnp.maximum(jnp.sin(2 * jnp.pi * time / 0.4) * jnp.array([1.0, -1, -1, 1]), 0)
        legs = jnp.stack([0 * swing, -0.2 * swing, 0.4 * swing], axis=1)
        return legs.ravel()  # abduction, hip and knee of each

    def cost(x, u, t):
        speed = 2 * ((x.qvel[0] - 0.5) ** 2 + x.qvel[1] ** 2)
        level = 10 * (x.qpos[4] ** 2 + x.qpos[5] ** 2) + 5 * x.qpos[6] ** 2
        legs = 0.5 * jnp.sum((x.qpos[7:] - pose(x.time)) ** 2)
        return speed + level + 20 * (x.qpos[2] - 0.3) ** 2 + legs + 0.05 * u @ u

    return trajopt.make_problem(
        model,
        horizon=20,
        running_cost=cost,
        final_cost=lambda x: 5 * cost(x, jnp.zeros(model.nu), 0),
        frame_skip=5,
    )


def _controlled(
    name: str,
    problem,
    ctrls,
    steps: int,
    method=None,
    first: int = 1,
    iterations: int = 1,
    plant=None,
):
    """Times of a controller, and the state it ends in."""
    import jax

    from jaxsim import trajopt

    method, state, spent = method or trajopt.ILQR(), problem.start, []
    now = method.start(problem, ctrls, jax.random.key(0))
    begun = time.perf_counter()
    replan = jax.jit(lambda now, state, n: trajopt.replan(problem, method, now, state, n))
    replan = replan.lower(now, state, iterations).compile()
    ready = time.perf_counter() - begun
    step, shift = jax.jit(plant or problem.step), jax.jit(method.shift)
    now = replan(now, state, first)
    for _ in range(steps):
        begun = time.perf_counter()
        now = jax.block_until_ready(replan(now, state, iterations))
        spent.append(time.perf_counter() - begun)
        state, now = step(state, now.ctrls[0]), shift(now)
    interval = 1e3 * problem.frame_skip * float(problem.space.model.opt.timestep)
    median, late = (1e3 * float(np.quantile(spent, q)) for q in (0.5, 0.95))
    row = {"task": name, "horizon": problem.horizon, "compile s": ready, "interval ms": interval}
    row |= {"median ms": median, "95 % ms": late, "real time": late <= interval}
    return row, state


if __name__ == "__main__":
    main()
