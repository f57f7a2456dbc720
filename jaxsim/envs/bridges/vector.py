"""`gymnasium.make_vec("jaxsim/Ant-v0", num_envs=4096)`: a batch behind Gymnasium's `VectorEnv`."""

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from jaxsim.envs.base.env import Env, EnvState
from jaxsim.envs.bridges import autoreset, batch, render
from jaxsim.envs.bridges.constant import Constant
from jaxsim.envs.bridges.fork import check_fork
from jaxsim.envs.bridges.spaces import action_space, observation_space, public_info, vector_info
from jaxsim.envs.registry.entries import make
from jaxsim.parallel.devices import dividing_mesh


class GymnasiumVectorEnv(VectorEnv):
    """Many environments with Gymnasium's vector interface, simulated in one compiled call.

    The batch is split over all of JAX's devices that divide it. A CPU is one device unless
    `jaxsim.configure_cpu()` is called before JAX is used.

    Attributes:
      env: the environment of `jaxsim.envs`, with its time limit; another one can be assigned, which
        compiles again.
      states: the batch of `EnvState`, on the devices; states that were read earlier stay valid.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 50}

    def __init__(
        self,
        env: Env | str,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: int | str | None = None,
        **options: Any,
    ):
        """Wrap an environment, or make one.

        Args:
          env: an environment, or the name of a registered one.
          num_envs: number of environments.
          autoreset_mode: when an environment is reset after an episode's end: in the next step
            (NEXT_STEP), in the same step, with its last observation in `infos["final_obs"]`
            (SAME_STEP), or by `reset(options={"reset_mask": mask})` (DISABLED).
          max_episode_steps: time limit, if the environment is given by name; None, or Gymnasium's
            -1, for none.
          render_mode: "rgb_array" or None.
          width: width of rendered frames in pixels.
          height: height of rendered frames in pixels.
          camera: name or number of a camera; -1 for a free camera; by default the one called
            "track".
          **options: the fields of the environment, where it is given by name.

        Raises:
          ValueError: num_envs is not positive, there is no such mode, or the environment holds a
            batch of models.
          RuntimeError: this process was forked after JAX had started.
        """
        if num_envs < 1:
            raise ValueError(f"num_envs must be positive, got {num_envs}")
        check_fork()
        if isinstance(env, str):
            limit = None if max_episode_steps == -1 else max_episode_steps
            env = make(env, max_episode_steps=limit, **options)
        batch.check_single(env)
        self.env, self.num_envs = env, num_envs
        self._constant = Constant(env)
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.render_mode = render.checked_mode(render_mode)
        fps = round(1 / float(env.dt))
        self.metadata = {**self.metadata, "render_fps": fps, "autoreset_mode": self.autoreset_mode}
        self.single_observation_space = observation_space(env)
        self.single_action_space = action_space(env)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._mesh = dividing_mesh(num_envs)
        self._batch: batch.Batch | None = None
        self._done = np.zeros(num_envs, bool)
        self._frames = render.frames(env, width, height, camera) if render_mode else None

    @property
    def states(self) -> EnvState | None:
        """The environments' states, every array with a leading batch axis."""
        return None if self._batch is None else self._batch.states

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ):
        """Start episodes.

        Args:
          seed: seed of each environment; an integer means seed, seed + 1, ...; None continues.
          options: `{"reset_mask": mask}` resets only the environments in a boolean mask.

        Returns:
          Observations of all environments and the infos of those that were reset.

        Raises:
          TypeError: the mask is not an array of booleans.
          ValueError: the mask or the seeds do not fit the number of environments.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        mask = _checked_mask((options or {}).get("reset_mask"), self.num_envs)
        if self._batch is None and not mask.all():
            raise gymnasium.error.ResetNeeded("the first reset() must be of all environments")
        keys = self._keys(seed, mask)
        if self._batch is None or mask.all():
            fresh = autoreset.compiled_start(self._placed(), self._mesh)(keys)
        else:
            old = self._batch.replace(keys=keys)
            fresh = autoreset.compiled_reset(self._placed(), self._mesh)(old, mask)
        self._batch = fresh
        return self._started(fresh, mask)

    def _started(self, fresh: batch.Batch, mask: np.ndarray):
        """The results of a reset on the host, in Gymnasium's format."""
        self._done = self._done & ~mask
        obs, info = jax.device_get((fresh.states.obs, public_info(fresh.states)))
        return np.array(obs), vector_info(info, mask)

    def _keys(self, seed: int | Sequence[int | None] | None, mask: np.ndarray) -> jax.Array:
        """Chains of keys, new ones where a seed is given or there was none before."""
        n = self.num_envs
        seeds = [seed + i for i in range(n)] if isinstance(seed, int) else list(seed or [None] * n)
        if len(seeds) != n:
            raise ValueError(f"reset needs {n} seeds, one for each environment, got {len(seeds)}")
        if self._batch is None:
            drawn = self.np_random.integers(2**32, size=n)
            seeds = [int(d) if s is None else s for s, d in zip(seeds, drawn, strict=True)]
            return batch.root_keys(seeds)
        given = np.array([s is not None for s in seeds]) & mask
        if not given.any():
            return self._batch.keys
        fresh = batch.root_keys([s or 0 for s in seeds])
        return jnp.where(given, fresh, self._batch.keys)

    def step(self, actions):
        """One step of every environment.

        Args:
          actions: controls, shape (num_envs, action size).

        Returns:
          Observations, rewards, terminations, truncations and infos; see `autoreset_mode`.

        Raises:
          gymnasium.error.ResetNeeded: `reset` was never called, or, with DISABLED, not for an
            environment that has ended.
        """
        if self._batch is None:
            raise gymnasium.error.ResetNeeded("call reset() before step()")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._done.any():
            raise gymnasium.error.ResetNeeded(
                f"environments {np.flatnonzero(self._done)[:10].tolist()} have ended: call "
                'reset(options={"reset_mask": mask}) first'
            )
        return self._advance(self._taken(actions))

    def _advance(self, actions: Any):
        """One step, with the results on the host; last observations only where there are any."""
        found = autoreset.compiled_step_for_host(self._placed(), self._mesh, self.autoreset_mode)
        program, layout = found
        self._batch, words, last = program(self._batch, actions, self._done)
        now: Any = layout.read(np.asarray(words))  # an `Outcome`
        self._done, infos = now.terminated | now.truncated, {}
        if last is not None and self._done.any():
            final: Any = layout.read(np.asarray(last))
            infos = vector_info(_final(final.obs, final.info, self._done), self._done)
            self._done = np.zeros_like(self._done)
        infos |= vector_info(now.info, np.ones_like(self._done))
        return now.obs, now.reward.astype(float), now.terminated, now.truncated, infos

    def _placed(self) -> Constant:
        check_fork()
        if self.env is not self._constant.value:
            self._constant = Constant(self.env)
        return self._constant

    def _taken(self, actions: Any):
        return np.asarray(actions, np.float32).reshape(self.action_space.shape)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One frame of every environment, or None without a render mode."""
        if self._frames is None or self._batch is None:
            return None
        states = jax.device_get(self._batch.states.state)
        each = (jax.tree.map(lambda x, i=i: x[i], states) for i in range(self.num_envs))
        return tuple(self._frames.frame(state) for state in each)

    def close_extras(self, **_: Any) -> None:
        """Free the renderer."""
        if self._frames is not None:
            self._frames.close()


def _checked_mask(mask, num_envs: int) -> np.ndarray:
    if mask is None:
        return np.ones(num_envs, bool)
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        kind = mask.dtype if isinstance(mask, np.ndarray) else type(mask).__name__
        raise TypeError(f"reset_mask must be a numpy array of booleans, got {kind}")
    if mask.shape != (num_envs,) or not mask.any():
        raise ValueError(
            f"reset_mask must have shape ({num_envs},) and a True in it, got shape {mask.shape} "
            f"with {mask.sum()} True"
        )
    return mask


def _final(obs: np.ndarray, info: dict[str, np.ndarray], done: np.ndarray) -> dict[str, Any]:
    """Last observations in Gymnasium's format: one array, or None, for each environment."""
    last = np.full(len(done), None, object)
    for i in np.flatnonzero(done):
        last[i] = obs[i].copy()
    return {"final_obs": last, "final_info": vector_info(info, done)}
