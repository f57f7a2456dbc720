"""Writes `docs/hoppers.gif`, the README's picture: a hundred hoppers, one policy, one batch.

Run `python docs/generate_picture.py`; it trains the policy first, in about two minutes, or takes
the directory of a run of `jaxsim train hopper` as its argument.
"""

import pathlib
import sys

import jax

import jaxsim
from jaxsim import rl, viz

PICTURE = pathlib.Path(__file__).parent / "hoppers.gif"
HOPPERS, SECONDS = 100, 3.0


def main():
    env = jaxsim.envs.make("hopper")
    policy = rl.load_policy(sys.argv[1], env) if len(sys.argv) > 1 else _trained()
    steps = round(SECONDS / float(env.dt))

    def episode(key):
        def step(state, _):
            state = env.step(state, policy(state.obs))
            return state, state.state

        states = jax.lax.scan(step, env.reset(key), length=2 * steps)[1]
        begin = jax.random.randint(key, (), steps // 2, steps)  # or all would hop in step
        shown = jax.tree.map(lambda x: jax.lax.dynamic_slice_in_dim(x, begin, steps), states)
        return shown.replace(
            qpos=shown.qpos.at[:, 0].add(-shown.qpos[0, 0]), time=states.time[:steps]
        )

    keys = jax.random.split(jax.random.key(0), HOPPERS)
    trajectory = jax.jit(jaxsim.vmap(episode))(keys)
    viz.film(env.model, trajectory, PICTURE, width=640, height=300, fps=20)


def _trained() -> rl.Policy:
    return rl.train("hopper", overrides=["target=3000"], progress=True).policy


if __name__ == "__main__":
    main()
