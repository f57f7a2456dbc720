"""How far a gradient through contact can be trusted: the policy gradient against the horizon.

An offset is added to all actions of a random policy for some steps. The derivative of the reward of
running forward with respect to it, averaged over environments, is compared with central differences
of a width (0.1) like a policy's noise, with the same random numbers. Cosines are those of the two
means, and the median of those of single environments.

examples:
  python benchmarks/policy_gradients.py
  python benchmarks/policy_gradients.py --envs hopper --softening 1 --batch 64
"""

import argparse
import dataclasses

import common
import numpy as np

HORIZONS = (1, 2, 4, 8, 16, 32)
WIDTH = 0.1  # of the differences
NOISE = 0.22  # standard deviation of the random policy
WARM_UP = 40  # steps before the first


def main() -> None:
    options = _options()
    common.setup()
    rows = [row for env in options.envs for row in measure(env, options)]
    print(common.table(rows))
    common.write(options, __file__, {"rows": rows})


def measure(name: str, options: argparse.Namespace) -> list[dict]:
    """One row for each softening and horizon."""
    import jax
    import jax.numpy as jnp

    from jaxsim import envs

    task, rows = envs.make(name).unwrapped, []
    states = _visited(task, options.batch)
    zero = jnp.zeros((options.batch, task.action_size))
    forward = jax.jit(lambda offset, count: _reward(task, offset, states, count))
    differences = {count: _differences(forward, zero, count) for count in HORIZONS}
    for softening in options.softening:
        backward = dataclasses.replace(task.model.backward, reverse_only=True, softening=softening)
        soft = task.with_model(task.model.replace(backward=backward))
        total = lambda offset, count, soft=soft: _reward(soft, offset, states, count).sum()  # noqa: E731
        gradient = jax.jit(jax.grad(total))
        for count in HORIZONS:
            found = np.asarray(gradient(zero, count))
            agreement = compare(found, differences[count])
            seconds = count * float(task.dt)
            rows.append({"env": name, "softening": softening, "steps": count, "s": seconds})
            rows[-1] |= agreement
    return rows


def compare(found: np.ndarray, expected: np.ndarray) -> dict[str, float]:
    """Agreement of gradients, one a row, with differences."""
    norms = np.linalg.norm(found, axis=1)
    return {
        "cosine": _cosine(found.mean(0), expected.mean(0)),
        "of one": float(np.median(_cosine(found, expected))),
        "ratio": float(np.linalg.norm(found.mean(0)) / np.linalg.norm(expected.mean(0))),
        "norm": float(np.median(norms)),
        "largest": float(norms.max()),
    }


def _cosine(a, b):
    norms = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    return (a * b).sum(-1) / np.maximum(norms, 1e-12)


def _differences(forward, zero, count: int) -> np.ndarray:
    columns = [
        (forward(zero.at[:, j].set(WIDTH), count) - forward(zero.at[:, j].set(-WIDTH), count))
        / (2 * WIDTH)
        for j in range(zero.shape[1])
    ]
    return np.stack(columns, -1)


def _reward(task, offset, states, count):
    """Reward for speed in the first `count` steps of each environment."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    def body(state, at):
        step, key = at
        action = jnp.tanh(offset + NOISE * jax.random.normal(key, offset.shape))
        state = jaxsim.vmap(task.step)(state, action)
        return state, jnp.where(step < count, state.metrics["reward_forward"], 0)

    steps = jnp.arange(max(HORIZONS)), jax.random.split(jax.random.key(1), max(HORIZONS))
    return jax.lax.scan(body, states, steps)[1].sum(0)


def _visited(task, batch: int):
    """States of the random policy, some steps after the start."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    def body(state, key):
        action = jnp.tanh(NOISE * jax.random.normal(key, (batch, task.action_size)))
        return jaxsim.vmap(task.step)(state, action), None

    start = jax.jit(jaxsim.vmap(task.reset))(jax.random.split(jax.random.key(0), batch))
    keys = jax.random.split(jax.random.key(3), WARM_UP)
    return jax.jit(lambda start: jax.lax.scan(body, start, keys)[0])(start)


def _options() -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=1)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    envs = ["hopper", "half_cheetah", "ant"]
    parser.add_argument("--envs", nargs="+", default=envs, help="environments")
    softening = "factors of time constants in the derivative (1 3)"
    parser.add_argument("--softening", nargs="+", type=float, default=[1.0, 3.0], help=softening)
    parser.add_argument("--batch", type=int, default=256, help="environments at once (256)")
    return parser.parse_args()


if __name__ == "__main__":
    main()
