"""Samples of a signal at increasing times, and the signal between them."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

HOLD, LINEAR, CUBIC = range(3)


def signal_at(
    times: Float[Array, "n"],
    values: Float[Array, "n dim"],
    at: Float[Array, ""],
    order: int,
    tolerance: Float[Array, ""],
) -> Float[Array, "dim"]:
    """The signal at a time; before the first sample and after the last one it is constant.

    Args:
        times: increasing times of the samples.
        values: their values.
        at: the time.
        order: HOLD for the last sample until then, LINEAR, or CUBIC for a cubic Hermite spline
            with the slopes of Catmull and Rom, zero at both ends.
        tolerance: with HOLD, a sample that is later than `at` by no more than this counts.
    """
    if len(times) == 1:
        return values[0]
    if order == HOLD:
        later = times[1:] > at + tolerance
        first, last = later[:1], ~later[-1:]
        return _chosen(jnp.concatenate([first, later[1:] & ~later[:-1], last]), values)
    at = jnp.clip(at, times[0], times[-1])
    end = jnp.ones(1, bool)
    begun = jnp.concatenate([end, times[1:-1] <= at])
    over = jnp.concatenate([times[1:-1] <= at, ~end])
    gap, rise = times[1:] - times[:-1], values[1:] - values[:-1]
    share = ((at - times[:-1]) / _divisor(gap))[:, None]
    if order == LINEAR:
        return _chosen(begun & ~over, values[:-1] + share * rise)
    still = jnp.zeros_like(values[:1])
    slope = (values[2:] - values[:-2]) / _divisor(times[2:] - times[:-2])[:, None]
    slope = jnp.concatenate([still, slope, still])
    left, right = gap[:, None] * slope[:-1], gap[:, None] * slope[1:]
    bend = 3 * rise - 2 * left - right + share * (left + right - 2 * rise)
    return _chosen(begun & ~over, values[:-1] + share * (left + share * bend))


def _chosen(which: Bool[Array, "n"], rows: Float[Array, "n dim"]) -> Float[Array, "dim"]:
    """The row that is chosen; numbers in the others do not matter, NaN included."""
    return jnp.sum(jnp.where(which[:, None], rows, 0), axis=0)


def _divisor(gap: Float[Array, "n"]) -> Float[Array, "n"]:
    """Samples at one time, which only the initial ones of a fast sensor are, are equal."""
    return jnp.where(gap > 0, gap, 1.0)
