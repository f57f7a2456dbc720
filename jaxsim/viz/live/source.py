"""What moves in a live view: a model under the user's controls, or a policy in its task."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.engine import forward, step
from jaxsim.model import Model, State, make_state


@struct.dataclass
class Inputs:
    """What a user changes while the simulation runs.

    Attributes:
      ctrl: controls.
      xfrc_applied: forces and torques on bodies, as in `State`.
      gravity: in the world (m/s^2).
      friction: factor of all geoms' friction.
    """

    ctrl: Float[Array, "nu"]
    xfrc_applied: Float[Array, "nbody 6"]
    gravity: Float[Array, "3"]
    friction: Float[Array, ""]

    @classmethod
    def of(cls, model: Model) -> "Inputs":
        """Those of the model itself: no controls, no forces."""
        dtype = model.qpos0.dtype
        nothing = jnp.zeros(model.nu, dtype), jnp.zeros((model.nbody, 6), dtype)
        return cls(*nothing, model.opt.gravity, jnp.ones((), dtype))

    def changed(self, model: Model) -> Model:
        """The model with this gravity and friction."""
        option = model.opt.replace(gravity=self.gravity)
        return model.replace(opt=option, geom_friction=self.friction * model.geom_friction)


class Free:
    """A model under the user's controls.

    Attributes:
      model: of one environment.
      dt: time of one step (s).
      steered: whether the user's controls count.
    """

    steered = True

    def __init__(self, model: Model, keyframe: int | str | None = None):
        """Start at `qpos0`, or at a keyframe."""
        self.model, self.dt = model, float(model.opt.timestep)
        self._start = make_state(model, keyframe)
        self._steps = jax.jit(self._many)
        self.contacts = jax.jit(lambda s, i: forward(i.changed(model), s, i.ctrl).contact)

    def reset(self, seed: int) -> State:
        """The first state; the seed plays no role."""
        return self._start

    def physics(self, state: State) -> State:
        """The state itself."""
        return state

    def advance(self, state: State, inputs: Inputs, count: int) -> State:
        """So many steps later."""
        return self._steps(state, inputs, count)

    def _many(self, state: State, inputs: Inputs, count) -> State:
        model = inputs.changed(self.model)
        state = state.replace(xfrc_applied=inputs.xfrc_applied)
        return jax.lax.fori_loop(0, count, lambda _, s: step(model, s, inputs.ctrl), state)


class Played(Free):
    """A policy that acts in its environment; an episode that ends starts again.

    Attributes:
      policy: function of an observation; a pytree of it may be replaced while it plays.
    """

    steered = False

    def __init__(self, env: Any, policy: Any):
        """Start where episodes of the environment start."""
        super().__init__(env.unwrapped.model)
        if not all(isinstance(leaf, jax.Array | np.ndarray) for leaf in jax.tree.leaves(policy)):
            policy = jax.tree_util.Partial(policy)  # a plain function: nothing in it changes
        self.env, self.policy, self.dt = env, policy, float(env.dt)
        self._reset, self._episodes = jax.jit(env.reset), 0
        self._act = jax.jit(self._acted)

    def reset(self, seed: int) -> Any:
        """The start of an episode."""
        return self._reset(jax.random.key(seed))

    def physics(self, state: Any) -> State:
        """The physics of an environment's state."""
        return state.state

    def advance(self, state: Any, inputs: Inputs, count: int) -> Any:
        """So many actions later, or at the start of another episode."""
        for _ in range(count):
            state = self._act(state, self.policy, inputs)
            if state.terminated or state.truncated:
                self._episodes += 1
                return self.reset(self._episodes)
        return state

    def _acted(self, state: Any, policy: Any, inputs: Inputs) -> Any:
        physics = state.state.replace(xfrc_applied=inputs.xfrc_applied)
        env = self.env.with_model(inputs.changed(self.model))
        return env.step(state.replace(state=physics), policy(state.obs))
