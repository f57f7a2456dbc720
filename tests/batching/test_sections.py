"""Programs in sections give what they gave, and XLA gets the sections as single functions."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jax.scipy.linalg import cho_factor, cho_solve

from jaxsim.arrays import tuning
from jaxsim.batching import vmap
from jaxsim.batching.jaxprs import bodies
from jaxsim.batching.sections import sectioned
from jaxsim.parallel.devices import compiled

LANES = 48


def _long(x, turns=20):
    """More than enough equations for a section."""
    for i in range(turns):
        x = jnp.where(x > i, jnp.sqrt(jnp.abs(x) + i), 0.5 * x - i)
    return x


def _branches(x, y):
    x = lax.cond(x[0, 0] > 0, _long, lambda x: -_long(x), x)
    return lax.switch(jnp.int32(y[0, 0]) % 3, [jnp.sin, _long, jnp.exp], x), y


def _loops(x, y):
    def body(state):
        i, x, best = state
        x = _long(x, 4) + y
        return i + 1, x, jnp.maximum(best, x[0] + x[2])

    first = jnp.int32(0), x, jnp.full(LANES, -jnp.inf)
    return lax.while_loop(lambda s: (s[0] < 7) & jnp.any(s[2] < 1e3), body, first)


def _scanned(x, y):
    def body(carry, row):
        carry = _long(carry) + row + jnp.tanh(y).sum(axis=0)
        return carry, carry * 2

    return lax.scan(body, x[0], jnp.concatenate([x, y]))


def _put_together(x, y):
    rows = [_long(x[i] * y[2 - i], 5) for i in range(3)]
    both = jnp.stack([jnp.concatenate([jnp.stack(rows), x]), jnp.concatenate([y, x + y])])
    return both[:, ::-1], jnp.pad(both, ((0, 0), (1, 2), (0, 0)))[1, 2:5]


def _integers(x, y):
    which = jnp.argsort(_long(x), axis=0)
    bits = (jnp.abs(y) * 7).astype(jnp.int32) << 2 ^ which
    taken = jnp.take_along_axis(_long(y), which, axis=0)
    return bits, taken > 0, taken.at[which[:, 0]].add(1.0)


def _products(x, y):
    square = jnp.tanh(_long(x)) @ jnp.tanh(_long(y)).T
    return jnp.linalg.solve(square @ square.T + jnp.eye(3), _long(x))


def _factors(x, y):
    """Loops over columns, chosen by platform, in solves that have derivatives of their own."""
    rows = jnp.concatenate([_long(x), _long(y)] * 2)
    matrices = jnp.tanh(rows[:, None, :8] * rows[None, :, :8]) + 12 * jnp.eye(12)[..., None]
    solve = vmap(lambda a, b: cho_solve(cho_factor(a, lower=True), b), in_axes=-1, out_axes=-1)
    return solve(matrices, rows[:, :8])


def _without_elements(x, y):
    none = _long(x[:0])
    return none, jnp.concatenate([none, _long(y)]), _long(jnp.zeros((0, 2)))


def _unnecessary(x, y):
    """XLA finds that the result does not depend on y."""
    return jnp.concatenate([_long(x), y])[:3] + jnp.where(False, _long(y), 0.0)


def _operands_as_results(x, y):
    x, again = jax.jit(lambda x: (x, _long(x)))(x)
    return x, y, again, again, jnp.float32(3), jnp.arange(5)


def _sums(x, y):
    return _long(x - x.mean(axis=1, keepdims=True)) / y.max(), jnp.cumsum(_long(y), axis=1)


TABLE = np.linspace(-1, 1, 400 * LANES).reshape(400, LANES).astype(np.float32)


def _constants(x, y):
    found = jnp.asarray(TABLE)[jnp.clip(jnp.int32(jnp.abs(x[:, :1]) * 100), 0, 399)[:, 0]]
    return _long(found * TABLE[7]) + _long(jnp.arange(3.0)[:, None] + y)


def _checkpointed(x, y):
    """Reverse mode that repeats the forward pass, in a loop and twice without one."""
    step = jax.checkpoint(lambda x, y: jnp.tanh(_long(x) + jnp.exp(y)))
    looped = lambda x, y: lax.scan(lambda x, _: (step(x, y), None), x, length=3)[0]  # noqa: E731
    loss = lambda x, y: jnp.sum(step(step(looped(x, y), y), x))  # noqa: E731
    return *jax.grad(loss, argnums=(0, 1))(x, y), step(x, y)


PROGRAMS = [
    _branches,
    _loops,
    _scanned,
    _put_together,
    _integers,
    _products,
    _factors,
    _sums,
    _without_elements,
    _unnecessary,
    _operands_as_results,
    _constants,
    _checkpointed,
]


@pytest.fixture
def arguments():
    rng = np.random.default_rng(3)
    return [jnp.asarray(rng.normal(size=(3, LANES)), jnp.float32) for _ in range(2)]


@pytest.mark.parametrize("f", PROGRAMS, ids=lambda f: f.__name__[1:])
def test_same_results(f, arguments):
    with jax.numpy_rank_promotion("allow"):
        expected = jax.jit(f)(*arguments)
        result = compiled(f, "cpu")(*arguments)
        assert "xla_cpu_small_call" in compiled(f, "cpu").lower(*arguments).as_text()
    # Sums and products are fused to other groups, which changes their rounding.
    close = functools.partial(np.testing.assert_allclose, rtol=2e-5, atol=2e-5)
    jax.tree.map(close, result, expected)
    kinds = functools.partial(jax.tree.map, lambda x: (x.shape, x.dtype))
    assert kinds(result) == kinds(expected)


def test_one_function_for_a_short_program(arguments):
    """Control flow included: nothing but the call is left."""
    traced = jax.make_jaxpr(sectioned(_loops, "cpu"))(*arguments)
    (section,) = (eqn for eqn in traced.eqns if eqn.primitive.name == "section")
    inner = {eqn.primitive.name for eqn in section.params["program"].jaxpr.eqns}
    assert "while" in inner
    assert not {"while", "add", "sqrt"} & {eqn.primitive.name for eqn in traced.eqns}


def test_long_loops_are_divided_inside(arguments):
    def f(x):
        body = lambda x, _: (_long(x, tuning.SECTION_MAX // 4), ())  # noqa: E731
        return lax.scan(body, x, length=3)[0]

    traced = jax.make_jaxpr(sectioned(f, "cpu"))(arguments[0])
    (loop,) = (eqn for eqn in traced.eqns if eqn.primitive.name == "scan")
    sections = [e for e in loop.params["jaxpr"].jaxpr.eqns if e.primitive.name == "section"]
    assert len(sections) > 1
    sizes = [len(e.params["program"].jaxpr.eqns) for e in sections]
    assert max(sizes) <= tuning.SECTION_MAX
    np.testing.assert_allclose(
        compiled(f, "cpu")(arguments[0]), jax.jit(f)(arguments[0]), rtol=2e-5
    )


def test_what_a_loop_does_not_change_is_in_no_section(arguments):
    """XLA takes it out of the loop; what only repeats numbers goes where it is read."""

    def f(x, scale):
        def body(x, _):
            spread = jnp.broadcast_to(jnp.exp(scale)[:, None], x.shape)
            return _long(x, tuning.SECTION_MAX // 4) * spread, ()

        return lax.scan(body, x, length=2)[0]

    traced = jax.make_jaxpr(sectioned(f, "cpu"))(arguments[0], jnp.ones(3))
    (loop,) = (eqn for eqn in traced.eqns if eqn.primitive.name == "scan")
    outside = [eqn.primitive.name for eqn in loop.params["jaxpr"].jaxpr.eqns]
    assert "exp" in outside
    for eqn in loop.params["jaxpr"].jaxpr.eqns:
        if eqn.primitive.name == "section":
            inside = [e.primitive.name for e in eqn.params["program"].jaxpr.eqns]
            assert "exp" not in inside


def test_a_backward_pass_repeats_the_forward_pass(arguments):
    """XLA must not see that both are the same, except for what a loop does not change."""

    def loss(x, y):
        step = jax.checkpoint(lambda x: jnp.sin(_long(x)) * jnp.exp(y))
        return jnp.sum(lax.scan(lambda x, _: (step(x), None), step(x), length=3)[0])

    forward = jax.make_jaxpr(sectioned(loss, "cpu"))(*arguments)
    assert "optimization_barrier" not in _names(forward)
    traced = jax.make_jaxpr(sectioned(jax.grad(loss), "cpu"))(*arguments)
    assert {"remat2", "checkpoint"}.isdisjoint(_names(traced))
    assert _names(traced).count("optimization_barrier") == 2
    back = [eqn for eqn in traced.eqns if eqn.primitive.name == "scan"][-1]
    *_, barrier = (
        eqn
        for eqn in back.params["jaxpr"].jaxpr.eqns
        if eqn.primitive.name == "optimization_barrier"
    )
    read = [v.aval.shape for v in barrier.invars]
    assert read == [(3, LANES), (3, LANES)]  # x and its cotangent, but not y


def _names(traced) -> list[str]:
    """All primitives outside sections."""
    found, jaxprs = [], [traced.jaxpr]
    while jaxprs:
        for eqn in jaxprs.pop().eqns:
            found.append(eqn.primitive.name)
            if eqn.primitive.name != "section":
                jaxprs.extend(bodies(eqn))
    return found


def test_dead_equations_are_dropped(arguments):
    def f(x):
        jnp.cumsum(_long(x))
        return _long(x)

    traced = jax.make_jaxpr(sectioned(f, "cpu"))(arguments[0])
    (section,) = (eqn for eqn in traced.eqns if eqn.primitive.name == "section")
    inside = {eqn.primitive.name for eqn in section.params["program"].jaxpr.eqns}
    assert "cumsum" not in inside


def test_effects_stay_and_keep_their_order(arguments):
    seen = []

    def f(x):
        x = _long(x)
        jax.debug.callback(lambda s: seen.append(float(s)), x[0, 0], ordered=True)
        x = _long(x)
        jax.debug.callback(lambda s: seen.append(float(s)), x[0, 0], ordered=True)
        return x

    result = compiled(f, "cpu")(arguments[0])
    jax.effects_barrier()
    once = _long(arguments[0])
    np.testing.assert_allclose(seen, [once[0, 0], _long(once)[0, 0]], rtol=1e-5)
    np.testing.assert_allclose(result, _long(once), rtol=1e-5)


def test_float64(arguments):
    with jax.enable_x64(True):
        doubles = [jnp.asarray(np.asarray(x), jnp.float64) for x in arguments]
        for f in (_loops, _put_together):
            close = functools.partial(np.testing.assert_allclose, rtol=1e-12)
            jax.tree.map(close, compiled(f, "cpu")(*doubles), jax.jit(f)(*doubles))


def test_library_calls_are_written_out(arguments):
    """What a CPU runs of a factor and its solves is part of the sections around it."""
    with jax.numpy_rank_promotion("allow"):
        text = compiled(_factors, "cpu").lower(*arguments).as_text()
        whole = text[text.index("func.func public @main") :]
    main = whole[: whole.index("func.func", 1)]
    assert "stablehlo.while" not in main
    assert "stablehlo.while" in text


def test_rows_of_a_stack_share_a_loop(arguments):
    """A cross product in a section is one fused loop, not one for each component."""

    def f(x, y):
        rows = [x[i] * y[j] - x[j] * y[i] for i, j in ((1, 2), (2, 0), (0, 1))]
        return _long(jnp.stack(rows))

    program = compiled(f, "cpu").lower(*arguments).compile()
    np.testing.assert_allclose(program(*arguments), jax.jit(f)(*arguments), rtol=1e-5)
    loops = re.findall(r"= f32\[1,48\]\S* fusion\(|= f32\[48\]\S* fusion\(", program.as_text())
    assert not loops


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_stacks_of_any_number_of_rows(count, arguments):
    def f(x, y):
        x = _long(x)
        rows = [x[i % 3] * y[(i + 1) % 3] + i for i in range(count)]
        along = [jnp.stack(rows, axis=axis) for axis in (0, 1)]
        return along, jnp.concatenate([along[0], x, along[0][:1]])

    close = functools.partial(np.testing.assert_allclose, rtol=1e-5)
    jax.tree.map(close, compiled(f, "cpu")(*arguments), jax.jit(f)(*arguments))
