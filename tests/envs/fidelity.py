"""Our tasks beside Gymnasium's: the same starts, the same actions, and what both make of them."""

import gymnasium
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jax import lax
from oracle import quick_jit

import jaxsim

GYMNASIUM = {
    "ant": "Ant-v5",
    "half_cheetah": "HalfCheetah-v5",
    "hopper": "Hopper-v5",
    "humanoid": "Humanoid-v5",
    "humanoid_standup": "HumanoidStandup-v5",
    "inverted_double_pendulum": "InvertedDoublePendulum-v5",
    "inverted_pendulum": "InvertedPendulum-v5",
    "reacher": "Reacher-v5",
    "swimmer": "Swimmer-v5",
    "walker2d": "Walker2d-v5",
}
_NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)


@struct.dataclass
class Script:
    """Where to start and what to do."""

    qpos: np.ndarray
    qvel: np.ndarray
    actions: np.ndarray  # (T, nu)


@struct.dataclass
class Trace:
    """What an agent gets at the start and after each of T steps."""

    obs: np.ndarray  # (T + 1, n)
    reward: np.ndarray  # (T,)
    terminated: np.ndarray  # (T,)


def theirs(name: str, converged: bool = False, **options) -> gymnasium.Env:
    """Gymnasium's environment without wrappers.

    Args:
      name: our name of the task.
      converged: solve for the contact forces to the end.
      options: what `gymnasium.make` takes.
    """
    env = gymnasium.make(GYMNASIUM[name], **options).unwrapped
    if converged:
        env.model.opt.solver, env.model.opt.iterations = _NEWTON, 100
    return env


def ours(name: str, **options) -> jaxsim.envs.Task:
    """Our environment without wrappers."""
    return jaxsim.envs.make(name, max_episode_steps=None, **options)


def script(env: gymnasium.Env, seed: int, steps: int) -> Script:
    """A start of Gymnasium's, and random actions."""
    rng, space = np.random.default_rng(seed), env.action_space
    env.reset(seed=seed)
    actions = rng.uniform(space.low, space.high, (steps, *space.shape))
    return Script(env.data.qpos.copy(), env.data.qvel.copy(), actions)


def nudged(plan: Script, seed: int, size: float = 1e-7) -> Script:
    """The same from positions that are a little away."""
    noise = np.random.default_rng(seed).standard_normal(plan.qpos.shape)
    return plan.replace(qpos=plan.qpos + size * noise)


def trace_theirs(env: gymnasium.Env, plan: Script, noise: float = 0.0, seed: int = 0) -> Trace:
    """What Gymnasium does; it goes on after the end of the episode, as ours does.

    With noise, positions and velocities are a little off after every step, as by rounding.
    """
    rng = np.random.default_rng(seed)
    env.reset(seed=0)
    env.set_state(plan.qpos, plan.qvel)
    found = [(env._get_obs(), 0.0, False)]
    for action in plan.actions:
        found.append(env.step(action)[:3])
        if noise:
            state = env.data.qpos, env.data.qvel
            env.set_state(
                *(x + noise * (1 + np.abs(x)) * rng.standard_normal(x.shape) for x in state)
            )
    obs, reward, terminated = (np.array(x) for x in zip(*found, strict=True))
    return Trace(obs, reward[1:], terminated[1:])


def trace_ours(env: jaxsim.envs.Task, plan: Script) -> Trace:
    """What we do."""
    return jax.tree.map(np.asarray, _trace(env, jax.tree.map(jnp.asarray, plan)))


@quick_jit
def _trace(env, plan):
    def step(state, action):
        state = env.step(state, action)
        return state, (state.obs, state.reward, state.terminated)

    first = env.reset_to(jaxsim.envs.start_from(env.model, plan.qpos, plan.qvel))
    obs, reward, terminated = lax.scan(step, first, plan.actions)[1]
    return Trace(jnp.concatenate([first.obs[None], obs]), reward, terminated)


def divergence(a: Trace, b: Trace) -> np.ndarray:
    """How far apart two traces are after each of T steps, as a part of what b shows."""

    def apart(x, y):
        error = np.abs(np.asarray(x, float) - y) / (1 + np.abs(y).max(0))
        return error.reshape(len(y), -1).max(1)

    return np.maximum(apart(a.obs, b.obs)[1:], apart(a.reward, b.reward))
