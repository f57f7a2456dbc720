"""A sum of many small terms that few digits hold."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

# Between a half and one unit in the last place of any number, however it is rounded.
_MOST_OF_A_UNIT = 0.51


def add_rounding_up(
    total: Float[Array, ""], excess: Float[Array, ""], term: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Adds a positive term to a sum that is rounded up, so that it always moves.

    What rounding added is kept and taken off the next term (Kahan 1965, "Further remarks on
    reducing truncation errors").

    Args:
        total: The sum before.
        excess: By how much it is more than the exact sum: from zero to one unit in its last place.
            A total that was set since, which says nothing of its excess, is taken for as exact.
        term: What to add.

    Returns:
        The sum and its excess. The sum's derivative is that of `total + term`.
    """
    eps = jnp.finfo(total.dtype).eps
    term = term - lax.stop_gradient(jnp.minimum(excess, eps * jnp.abs(total)))
    after = total + term
    low = lax.stop_gradient(term - (after - total) > 0)
    after = after + jnp.where(low, _MOST_OF_A_UNIT * eps * lax.stop_gradient(jnp.abs(after)), 0)
    return after, lax.stop_gradient(jnp.maximum((after - total) - term, 0))
