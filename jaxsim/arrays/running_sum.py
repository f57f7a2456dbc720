"""A running sum of small terms that keeps its accuracy in float32."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

# In units of the last place; more than a half, so that rounding to nearest always rounds up.
_MOST_OF_A_UNIT = 0.51


def add_rounding_up(
    total: Float[Array, ""], excess: Float[Array, ""], term: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Add a positive term to a sum that is rounded up, so that the sum always increases.

    The amount added by rounding is stored and subtracted from the next term (Kahan 1965, "Further
    remarks on reducing truncation errors").

    Args:
        total: The sum so far.
        excess: `total` minus the exact sum, from zero to one unit in the last place of `total`.
            It is clipped to that range, in case a user has assigned `total` since.
        term: The term to add.

    Returns:
        The sum and its excess. The sum's derivative is that of `total + term`.
    """
    eps = jnp.finfo(total.dtype).eps
    term = term - lax.stop_gradient(jnp.minimum(excess, eps * jnp.abs(total)))
    after = total + term
    low = lax.stop_gradient(term - (after - total) > 0)
    after = after + jnp.where(low, _MOST_OF_A_UNIT * eps * lax.stop_gradient(jnp.abs(after)), 0)
    return after, lax.stop_gradient(jnp.maximum((after - total) - term, 0))
