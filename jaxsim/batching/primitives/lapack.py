"""LAPACK's routines, called on a CPU for one matrix at a time.

Some releases of jaxlib (such as 0.10.2) divide a batch among the threads of the process and wait
for them. If several devices do so at once, all threads wait and the program hangs. A single matrix
is computed by the calling thread. A loop of such calls takes about as long as a batched one: for LU
and two substitutions of 27 rows 6.0 us against 5.7 (128 lanes, one core), of 12 rows 2.2 against
1.7.
"""

import jax
import jax.numpy as jnp
from jax import lax

from jaxsim.batching import jaxprs
from jaxsim.batching.primitives.derivatives import with_jvp
from jaxsim.batching.registry import register


def one_by_one(lanes, eqn, values, flags):
    """One call for each matrix on a CPU, the batched routine elsewhere.

    Only the value is computed here; the derivative is that of the primitive.
    """
    outer = eqn.invars[0].aval.ndim - (1 if eqn.primitive.name == "tridiagonal_solve" else 2)
    routine = jaxprs.rebind(eqn)

    def loop(*xs):
        together = routine
        for _ in range(outer):
            together = _mapped(together)
        return _mapped(together)(*(jnp.moveaxis(x, -1, 0) for x in xs))

    def library(*xs):
        return jax.vmap(routine, -1)(*xs)

    def batched(*xs):
        results = lax.platform_dependent(*xs, cpu=loop, default=library)
        return [jnp.moveaxis(x, 0, -1) for x in results]

    full = [lanes.broadcast(v, f) for v, f in zip(values, flags, strict=True)]
    return with_jvp(lanes, eqn, [True] * len(full), batched)(*full)


def _mapped(f):
    return lambda *xs: lax.map(lambda x: f(*x), xs)


register(
    *"""
    cholesky_update eig eigh geqp3 geqrf hessenberg householder_product ormqr qr schur svd
    tridiagonal tridiagonal_solve
    """.split(),
    rule=one_by_one,
)
