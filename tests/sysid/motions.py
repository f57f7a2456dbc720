"""Recordings made by a model, with noise."""

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.sysid import Recording


def recorded(model, qpos, qvel, ctrl, rng, noise):
    """Noisy recordings of motions from several states; no joint of the model has a quaternion."""
    start = jaxsim.make_state(model)

    def run(q, v, u):
        return jaxsim.rollout(model, start.replace(qpos=q, qvel=v), u)[1]

    path = quick_jit(jax.vmap(run))(*(jnp.asarray(a) for a in (qpos, qvel, ctrl)))
    found = []
    for i, (q, v, u) in enumerate(zip(qpos, qvel, ctrl, strict=True)):
        q, v = np.concatenate([q[None], path.qpos[i]]), np.concatenate([v[None], path.qvel[i]])
        q, v = (x + n * rng.normal(size=x.shape) for x, n in zip((q, v), noise, strict=True))
        found.append(Recording(q, u, v))
    return found
