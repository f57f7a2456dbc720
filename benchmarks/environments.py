"""Steps per second of environments: compiled, in Gymnasium's and Brax's shapes; Gymnasium's own.

A part of `throughput.py`. Random actions, episodes that end begin anew. EnvPool, MuJoCo C
in threads, stands beside them where it is installed (`pip install envpool`).
"""

import importlib.util

import common
import numpy as np

GYMNASIUM = {
    "inverted_pendulum": "InvertedPendulum-v5",
    "inverted_double_pendulum": "InvertedDoublePendulum-v5",
    "reacher": "Reacher-v5",
    "swimmer": "Swimmer-v5",
    "hopper": "Hopper-v5",
    "half_cheetah": "HalfCheetah-v5",
    "walker2d": "Walker2d-v5",
    "ant": "Ant-v5",
    "humanoid": "Humanoid-v5",
}


def rows(name: str, options) -> list[dict]:
    """One row for each way to step the environment."""
    steps = options.env_steps
    candidates = {
        "jaxsim, compiled": (_compiled(name, options.batch, steps), options.batch),
        "jaxsim, VectorEnv": (_vector(name, options.batch, steps), options.batch),
        "jaxsim, Brax's API": (_brax(name, options.batch, steps), options.batch),
        "Gymnasium, sync": (_gymnasium(name, "sync", 8, steps), 8),
        "Gymnasium, async": (_gymnasium(name, "async", options.devices, steps), options.devices),
    }
    if importlib.util.find_spec("envpool"):
        candidates["EnvPool"] = (_envpool(name, options), options.batch)
    runs = {peer: run for peer, (run, _) in candidates.items()}
    times = common.interleave(runs, options.repetitions)
    found = []
    for peer, (_, envs) in candidates.items():
        time = times[peer].per(envs * steps)
        found.append(
            {
                "environment": name,
                "by": peer,
                "envs": envs,
                "env steps/s": 1 / time.median,
                "spread %": 100 * time.spread / time.median,
            }
        )
    return found


def _compiled(name: str, batch: int, steps: int):
    """A scan of steps, environments split over all devices."""
    import jax

    import jaxsim
    from jaxsim.envs.wrappers import AutoReset
    from jaxsim.parallel.devices import SPLIT, device_mesh, parallel

    env, mesh = AutoReset(env=jaxsim.envs.make(name)), device_mesh()

    def advance(state, key):
        def body(state, key):
            return env.step(state, _action(env, key)), None

        return jax.lax.scan(body, state, jax.random.split(key, steps))[0]

    reset = parallel(jaxsim.vmap(env.reset), mesh, SPLIT, SPLIT)
    step = parallel(jaxsim.vmap(advance), mesh, (SPLIT, SPLIT), SPLIT)
    keys = jax.random.split(jax.random.key(0), batch)
    state = reset(keys)
    return lambda: jax.block_until_ready(step(state, keys))


def _brax(name: str, batch: int, steps: int):
    """Brax's `step` and `done`, batched by our wrapper of it, on one device."""
    import jax

    from jaxsim.envs.bridges.brax_env import BraxEnv, wrap_for_brax

    env = wrap_for_brax(BraxEnv(name), episode_length=1000, action_repeat=1)
    low, high = -np.ones((batch, env.action_size)), np.ones((batch, env.action_size))

    @jax.jit
    def advance(state, key):
        def body(state, key):
            action = jax.random.uniform(key, low.shape, minval=low, maxval=high)
            return env.step(state, action), None

        return jax.lax.scan(body, state, jax.random.split(key, steps))[0]

    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), batch))
    key = jax.random.PRNGKey(1)
    return lambda: jax.block_until_ready(advance(state, key))


def _vector(name: str, batch: int, steps: int):
    import gymnasium

    title = "".join(part.capitalize() for part in name.split("_"))
    return _stepper(gymnasium.make_vec(f"jaxsim.envs:jaxsim/{title}-v0", num_envs=batch), steps)


def _gymnasium(name: str, mode: str, envs: int, steps: int):
    import gymnasium

    # Processes that are not forked, as JAX has threads already.
    kwargs = {"context": "spawn"} if mode == "async" else {}
    vector = gymnasium.make_vec(
        GYMNASIUM[name], num_envs=envs, vectorization_mode=mode, vector_kwargs=kwargs
    )
    return _stepper(vector, steps)


def _envpool(name: str, options):
    import envpool

    threads = min(options.batch, options.devices)
    vector = envpool.make(
        GYMNASIUM[name], "gymnasium", num_envs=options.batch, num_threads=threads, seed=0
    )
    low, high = vector.action_space.low, vector.action_space.high
    rng = np.random.default_rng(0)
    shape = (options.env_steps, options.batch, *low.shape)
    actions = rng.uniform(low, high, shape).astype(vector.action_space.dtype)
    vector.reset()

    def run():
        for action in actions:
            vector.step(action)

    return run


def _stepper(envs, steps: int):
    envs.reset(seed=0)
    actions = [envs.action_space.sample() for _ in range(steps)]

    def run():
        for action in actions:
            envs.step(action)

    return run


def _action(env, key):
    import jax

    return jax.random.uniform(
        key, (env.action_size,), minval=env.action_low, maxval=env.action_high
    )
