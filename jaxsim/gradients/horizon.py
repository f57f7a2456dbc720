"""Gradients over many steps: truncation, clipping, and a report of their growth.

The gradient of a state after a hundred steps is a product of a hundred Jacobians. Through stiff
contacts it grows until it is not useful as a descent direction.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int


def clip_cotangent(x: Any, limit: float | Float[Array, ""]) -> Any:
    """Return x; in reverse mode, its cotangent is scaled down to at most this norm.

    The cotangent g becomes `g min(1, limit / |g|)`, or zero if it is not finite. Apply it to the
    state in the body of a loop.

    Args:
      x: a pytree of arrays; |g| is the norm over all those of floating point together.
      limit: largest norm that passes.
    """
    return _with_scaled_cotangent(x, limit, _shortening)


def stop_cotangent(x: Any, limit: float | Float[Array, ""]) -> Any:
    """Return x; in reverse mode, its cotangent is zero if it is longer than this, or not finite.

    In the body of a loop this makes windows whose lengths adapt: the derivative goes back from the
    end through as many steps as it stays below the limit, until stiff contact ends it.

    Args:
      x: a pytree of arrays; the norm is that over all those of floating point together.
      limit: largest norm that passes.
    """
    return _with_scaled_cotangent(x, limit, _below)


def _shortening(square: Float[Array, ""], limit) -> Float[Array, ""]:
    """The factor that brings a vector down to a length; it has no root at zero."""
    return jnp.minimum(1, limit * lax.rsqrt(jnp.maximum(square, 1e-30)))


def _below(square: Float[Array, ""], limit) -> Float[Array, ""]:
    """One for vectors up to a length, otherwise zero."""
    return jnp.where(square <= limit**2, 1.0, 0.0)


def _with_scaled_cotangent(x: Any, limit, factor: Callable) -> Any:
    """Return x; the cotangent g is multiplied by `factor(|g|^2, limit)`."""
    leaves, structure = jax.tree.flatten(x)
    smooth = [jnp.issubdtype(jnp.result_type(a), jnp.floating) for a in leaves]
    scaled = iter(_scaled(factor, [a for a, s in zip(leaves, smooth, strict=True) if s], limit))
    return structure.unflatten(
        [next(scaled) if s else a for a, s in zip(leaves, smooth, strict=True)]
    )


@functools.partial(jax.custom_vjp, nondiff_argnums=(0,))
def _scaled(factor, leaves, limit):
    return leaves


def _scale_forward(factor, leaves, limit):
    return leaves, limit


def _scale_backward(factor, limit, cotangents):
    square = sum((jnp.sum(jnp.square(c)) for c in cotangents), start=jnp.zeros(()))
    # An overflow of the square is treated like NaN.
    share, finite = factor(square, limit), jnp.isfinite(square)
    scaled = [jnp.where(finite, share.astype(c.dtype) * c, 0) for c in cotangents]
    return scaled, jnp.zeros_like(jnp.asarray(limit))


_scaled.defvjp(_scale_forward, _scale_backward)


def truncate(x: Any, cut: Bool[Array, ""] | bool) -> Any:
    """Return x, with derivative zero where `cut` is true.

    `truncate(state, t % 32 == 0)` in the body of a loop makes windows of 32 steps.
    """
    return jax.tree.map(lambda a: jnp.where(cut, lax.stop_gradient(a), a), x)


def gradient_norms(
    step: Callable[[Any, Any], Any],
    loss: Callable[[Any], Float[Array, ""]],
    state: Any,
    inputs: Any,
) -> Float[Array, "T+1"]:
    """Norms of the gradients of a final loss with respect to all states of a trajectory.

    Args:
      step: from a state and an input to the next state, for instance `jaxsim.step` of a model.
      loss: function of the final state.
      state: initial state.
      inputs: inputs of all steps, stacked along a leading axis.

    Returns:
      `|d loss(x_T) / d x_t|` for t = 0 to T: how the gradient grows with the horizon T - t.
    """
    final, states = lax.scan(lambda x, u: (step(x, u), x), state, inputs)
    last = jax.grad(loss)(final)

    def back(cotangent, at):
        x, u = at
        _, pull = jax.vjp(lambda x: step(x, u), x)
        (cotangent,) = pull(cotangent)
        return cotangent, tree_norm(cotangent)

    _, norms = lax.scan(back, last, (states, inputs), reverse=True)
    return jnp.concatenate([norms, tree_norm(last)[None]])


def usable_horizon(norms: Float[Array, "T+1"], growth: float = 10.0) -> Int[Array, ""]:
    """Number of steps before the end in which gradients stay below a multiple of the last.

    Args:
      norms: result of `gradient_norms`.
      growth: the multiple.
    """
    fine = (norms[::-1] <= growth * norms[-1]) & jnp.isfinite(norms[::-1])
    return jnp.sum(jnp.cumprod(fine.astype(jnp.int32))) - 1


def tree_norm(x: Any) -> Float[Array, ""]:
    """Euclidean norm of all numbers of a pytree."""
    return jnp.sqrt(sum((jnp.sum(a * a) for a in jax.tree.leaves(x)), jnp.zeros(())))
