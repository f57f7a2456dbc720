"""Gradients over many steps: truncation, clipping, and a report of their growth.

The gradient of a state after a hundred steps is a product of a hundred Jacobians. Through stiff
contacts it grows until it is not useful as a descent direction.
"""

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
    leaves, structure = jax.tree.flatten(x)
    smooth = [jnp.issubdtype(jnp.result_type(a), jnp.floating) for a in leaves]
    clipped = iter(_clipped([a for a, s in zip(leaves, smooth, strict=True) if s], limit))
    return structure.unflatten(
        [next(clipped) if s else a for a, s in zip(leaves, smooth, strict=True)]
    )


@jax.custom_vjp
def _clipped(leaves, limit):
    return leaves


def _clip_forward(leaves, limit):
    return leaves, limit


def _clip_backward(limit, cotangents):
    square = sum((jnp.sum(jnp.square(c)) for c in cotangents), start=jnp.zeros(()))
    # An overflow of the square is treated like NaN.
    factor = jnp.minimum(1, limit * lax.rsqrt(jnp.maximum(square, 1e-30)))
    finite = jnp.isfinite(square)
    clipped = [jnp.where(finite, factor.astype(c.dtype) * c, 0) for c in cotangents]
    return clipped, jnp.zeros_like(jnp.asarray(limit))


_clipped.defvjp(_clip_forward, _clip_backward)


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
