"""Equal programs have equal digests, in any process; others have not."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxsim.lanes.identity import digest

SCRIPT = """
import sys; sys.path.insert(0, {folder!r})
import jax; from test_identity import program
from jaxsim.lanes.identity import digest
print(digest(program(2.0)))
"""


def program(factor, table=(1.0, 2.0)):
    """With a literal, a constant, a loop, a branch and a custom derivative."""
    known = np.array(table, np.float32)

    def f(x):
        y = lax.while_loop(lambda y: jnp.sum(y) < 9, lambda y: factor * y + known, jnp.abs(x))
        return jax.nn.relu(lax.cond(x[0] > 0, lambda: y, lambda: -y))

    return jax.make_jaxpr(f)(jnp.ones(2, jnp.float32))


def test_what_it_depends_on():
    assert digest(program(2.0)) == digest(program(2.0))
    others = program(2.0000002), program(2.0, (1.0, 2.0000002)), jax.make_jaxpr(jnp.sin)(1.0)
    assert len({digest(p) for p in (program(2.0), *others)}) == 4


def test_another_process():
    folder = __file__.rpartition("/")[0]
    code = SCRIPT.format(folder=folder)
    run = [sys.executable, "-c", code]
    done = subprocess.run(run, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == digest(program(2.0))
