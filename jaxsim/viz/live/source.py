"""What moves in a live view: a model under the user's controls, or a policy in its task."""

from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.engine import forward, step
from jaxsim.io import set_const
from jaxsim.model import Model, State, make_state


@struct.dataclass
class Parameters:
    """What of a model a user changes while the simulation runs.

    Attributes:
      gravity: along z (m/s^2).
      friction: factor of all geoms' friction.
      damping: factor of all joints' damping.
      mass: factor of each body's mass and inertia.
    """

    gravity: float | Float[Array, ""]
    friction: float | Float[Array, ""]
    damping: float | Float[Array, ""]
    mass: tuple[float, ...] | Float[Array, "nbody"]

    @classmethod
    def of(cls, model: mujoco.MjModel) -> "Parameters":
        """Those that change nothing."""
        return cls(float(model.opt.gravity[2]), 1.0, 1.0, (1.0,) * model.nbody)

    def changed(self, model: Model) -> Model:
        """The model with these numbers, and all constants that follow from them."""
        mass = jnp.asarray(self.mass)
        return set_const(
            model.replace(
                opt=model.opt.replace(gravity=model.opt.gravity.at[2].set(self.gravity)),
                geom_friction=self.friction * model.geom_friction,
                dof_damping=self.damping * model.dof_damping,
                body_mass=mass * model.body_mass,
                body_inertia=mass[:, None] * model.body_inertia,
            )
        )


@struct.dataclass
class Inputs:
    """What a step takes from the user, besides the state.

    Its numbers are arguments of the compiled step, so that none of them compiles it again.

    Attributes:
      model: with the user's parameters.
      ctrl: controls.
      xfrc_applied: forces and torques on bodies, as in `State`.
    """

    model: Model
    ctrl: Float[Array, "nu"]
    xfrc_applied: Float[Array, "nbody 6"]

    @classmethod
    def of(cls, model: Model) -> "Inputs":
        """No controls, no forces."""
        dtype = model.qpos0.dtype
        return cls(model, jnp.zeros(model.nu, dtype), jnp.zeros((model.nbody, 6), dtype))


class Free:
    """A model under the user's controls.

    Attributes:
      model: of one environment.
      dt: time of one step (s).
      changed: the model with other `Parameters`.
      contacts: of a state, with `Inputs`.
      steered: whether the user's controls count.
    """

    steered = True

    def __init__(self, model: Model, keyframe: int | str | None = None):
        """Start at `qpos0`, or at a keyframe."""
        self.model, self.dt = model, float(model.opt.timestep)
        self._start = make_state(model, keyframe)
        self._steps = jax.jit(self._many)
        self.changed = jax.jit(lambda parameters: parameters.changed(model))
        self.contacts = jax.jit(lambda s, i: forward(i.model, s, i.ctrl).contact)

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
        state = state.replace(xfrc_applied=inputs.xfrc_applied)
        return jax.lax.fori_loop(0, count, lambda _, s: step(inputs.model, s, inputs.ctrl), state)


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
        env = self.env.with_model(inputs.model)
        return env.step(state.replace(state=physics), policy(state.obs))
