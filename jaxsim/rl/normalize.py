"""Running mean and variance of observations and returns, merged over devices."""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

LIMIT = 10.0  # standard deviations beyond which a normalised number is clipped
PLAUSIBLE = 30.0  # standard deviations beyond which a sample says nothing about the deviation
JUDGES = 1024  # samples that say what is plausible when nothing has been seen before


@struct.dataclass
class RunningStatistics:
    """Mean and variance of all samples so far.

    Attributes:
      count: number of samples.
      mean: their mean.
      variance: their variance, divided by `count`.
    """

    count: Float[Array, ""]
    mean: Float[Array, "..."]
    variance: Float[Array, "..."]

    @classmethod
    def start(cls, shape: tuple[int, ...]) -> "RunningStatistics":
        """No samples yet: mean 0, variance 1."""
        return cls(jnp.zeros(()), jnp.zeros(shape), jnp.ones(shape))

    def update(
        self, samples: Float[Array, "n ..."], axis_name: str | None = None
    ) -> "RunningStatistics":
        """Include samples, those of all devices along `axis_name`.

        Two sets are merged by Chan's formula: with d the difference of the means and w the
        fraction of the new samples, mean = m + w d and
        variance = (1 - w) v + w v_new + w (1 - w) d^2. Samples that are not finite are replaced by
        the mean, and extreme samples are clipped to plausible limits, so that one diverging
        simulation does not spoil the normalisation. The limits grow if all samples grow.
        """
        samples = jnp.where(jnp.isfinite(samples), samples, self.mean[None])
        low, high = lax.cond(self.count > 0, self._plausible, lambda: _typical(samples))
        samples = jnp.clip(samples, low[None], high[None])
        count = jnp.asarray(samples.shape[0], self.count.dtype)
        mean = samples.mean(0)
        if axis_name is not None:
            mean, count = lax.pmean(mean, axis_name), lax.psum(count, axis_name)
        variance = jnp.square(samples - mean[None]).mean(0)
        if axis_name is not None:
            variance = lax.pmean(variance, axis_name)
        total = self.count + count
        w, d = count / total, mean - self.mean
        merged = (1 - w) * self.variance + w * variance + w * (1 - w) * d**2
        return RunningStatistics(total, self.mean + w * d, merged)

    def _plausible(self):
        """Limits from the statistics so far, at least one unit from the mean."""
        reach = 1 + PLAUSIBLE * jnp.sqrt(self.variance)
        return self.mean - reach, self.mean + reach

    def normalize(self, x: Float[Array, "..."]) -> Float[Array, "..."]:
        """(x - mean) / std, clipped to +-10; a constant becomes 0."""
        std = jnp.sqrt(self.variance + 1e-6)
        mean, std = (jnp.broadcast_to(s, x.shape) for s in (self.mean, std))
        return jnp.clip((x - mean) / std, -LIMIT, LIMIT)


def _typical(samples: Float[Array, "n ..."]):
    """Limits from the samples: from the 75th percentile of their distance to the median."""
    some = samples[:: -(-samples.shape[0] // JUDGES)]
    middle = jnp.median(some, axis=0)
    reach = 1 + 3 * PLAUSIBLE * jnp.quantile(jnp.abs(some - middle[None]), 0.75, axis=0)
    return middle - reach, middle + reach


def discounted_returns(
    before: Float[Array, "n"],
    rewards: Float[Array, "T n"],
    done: Bool[Array, "T n"],
    discount: float,
) -> tuple[Float[Array, "n"], Float[Array, "T n"]]:
    """Discounted sums of past rewards, whose standard deviation scales the rewards.

    g_t = r_t + discount g_{t-1}, where g_{t-1} is 0 at the start of an episode. Dividing by the
    deviation of g makes returns of about one, whatever the task's units.

    Args:
      before: g of the step before the first; 0 for new episodes.
      rewards: rewards of the steps.
      done: whether the episode ended with a step.
      discount: factor per step.

    Returns:
      `before` for the next steps, and g of all steps.
    """

    def body(g, step):
        reward, done = step
        g = reward + discount * g
        return jnp.where(done, 0, g), g

    return jax.lax.scan(body, before, (rewards, done))
