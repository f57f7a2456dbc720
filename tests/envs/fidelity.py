"""Our tasks beside Gymnasium's: the same starts, the same actions, and what both make of them."""

import functools

import gymnasium
import jax.numpy as jnp
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


@struct.dataclass
class Trace:
    """What an agent gets at the start and after each of T steps."""

    obs: np.ndarray  # (T + 1, n)
    reward: np.ndarray  # (T,)
    terminated: np.ndarray  # (T,)
    qpos: np.ndarray  # (T + 1, nq)


@struct.dataclass
class Script:
    """Where to start and what to do."""

    qpos: np.ndarray
    qvel: np.ndarray
    actions: np.ndarray  # (T, nu)


@functools.cache
def theirs(name: str, **options) -> gymnasium.Env:
    """Gymnasium's environment without wrappers."""
    return gymnasium.make(GYMNASIUM[name], **options).unwrapped


def script(name: str, seed: int, steps: int) -> Script:
    """A start of Gymnasium's, and random actions."""
    env, rng = theirs(name), np.random.default_rng(seed)
    env.reset(seed=seed)
    space = env.action_space
    actions = rng.uniform(space.low, space.high, (steps, *space.shape))
    return Script(env.data.qpos.copy(), env.data.qvel.copy(), actions)


def nudged(plan: Script, size: float = 1e-7) -> Script:
    """The same from positions that are a little away."""
    noise = np.random.default_rng(1).standard_normal(plan.qpos.shape)
    return plan.replace(qpos=plan.qpos + size * noise)


def trace_theirs(env: gymnasium.Env, plan: Script) -> Trace:
    """What Gymnasium does; it goes on after the end of the episode, as ours does."""
    env.reset(seed=0)
    env.set_state(plan.qpos, plan.qvel)
    found = [(env._get_obs(), 0.0, False, env.data.qpos.copy())]
    for action in plan.actions:
        obs, reward, terminated, _, _ = env.step(action)
        found.append((obs, reward, terminated, env.data.qpos.copy()))
    obs, reward, terminated, qpos = (np.array(x) for x in zip(*found, strict=True))
    return Trace(obs, reward[1:], terminated[1:], qpos)


@quick_jit
def trace_ours(env: jaxsim.envs.Task, plan: Script) -> Trace:
    """What we do."""

    def step(state, action):
        state = env.step(state, action)
        return state, (state.obs, state.reward, state.terminated, state.state.qpos)

    first = env.reset_to(jaxsim.envs.start_from(env.model, plan.qpos, plan.qvel))
    _, (obs, reward, terminated, qpos) = lax.scan(step, first, plan.actions)
    obs = jnp.concatenate([first.obs[None], obs])
    return Trace(obs, reward, terminated, jnp.concatenate([first.state.qpos[None], qpos]))


def divergence(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Largest difference up to each time, over all entries."""
    each = np.abs(np.asarray(a, float) - np.asarray(b, float)).reshape(len(a), -1).max(1)
    return np.maximum.accumulate(each)
