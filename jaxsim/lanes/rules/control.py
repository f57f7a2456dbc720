"""Rules of calls, loops and branches."""

import numpy as np

from jaxsim.batching import divergence, forms, jaxprs
from jaxsim.lanes.program.graph import CONTROL, PARAM, RESULT, Branch, Loop
from jaxsim.lanes.program.scalars import OPS
from jaxsim.lanes.program.types import BOOL
from jaxsim.lanes.translate import evaluate, rule

# Iterations are written out as long as they are known and the program stays this short.
UNROLLED_NODES = 3_000
UNROLLED_EQUATIONS = 1_500
# A branch of so few equations is computed in any case.
INLINED_BRANCH = 12
LARGEST_STACK = 1_024


@rule(
    "jit",
    "pjit",
    "closed_call",
    "core_call",
    "remat2",
    "checkpoint",
    "custom_jvp_call",
    "custom_vjp_call",
    "custom_vjp_call_jaxpr",
    "own_kernel",
    "jvp_rule",
    "one_at_a_time",
)
def call(t, eqn, *values):
    """The equations of the function."""
    form = forms.read(eqn)
    if form is None:
        program = eqn.params.get("program")
        return None if program is None else evaluate(t, forms.program(program), values)
    return evaluate(t, form.body, values)


@rule("lane_call")
def lane_call(t, eqn, *values):
    """A kernel within this one."""
    program = forms.program(eqn.params["program"])
    with t.finite_math_if(eqn.params["finite_math"]):
        return evaluate(t, program, values)


@rule("custom_linear_solve")
def linear_solve(t, eqn, *values):
    """The solver; the rest serves derivatives."""
    form = forms.read(eqn)
    if form is None or form.parts["solve"] is None:
        return None
    count, first = sum(form.counts.values()), form.counts["matvec"] + form.counts["vecmat"]
    own = values[first : first + form.counts["solve"]]
    return evaluate(t, form.parts["solve"], [*own, *values[count:]])


@rule("any_in_batch")
def any_in_batch(t, eqn, x):
    """Whether it holds in any lane of a group, which decides together."""
    if not x.size:
        return x
    known = t.is_const(x) | t.uniform[x]
    if known.all():
        return x
    found = t.intern(OPS["any"], BOOL, x.reshape(1, -1))
    t.uniform[found] = True
    return np.where(known, x, found.reshape(x.shape)).astype(np.int32)


@rule("is_batched")
def is_batched(t, eqn, x):
    """Here is a batch."""
    return t.constants(np.asarray(True))


@rule("in_cpu_kernel")
def in_cpu_kernel(t, eqn, x):
    """Here is a kernel, for a CPU or another processor."""
    return t.constants(np.asarray(t.for_cpu))


@rule("platform_index")
def platform_index(t, eqn, *values):
    """Which platform; the branch is chosen where it is used."""
    return t.constants(np.zeros((), eqn.outvars[0].aval.dtype))


def _batched(t, values) -> list[bool]:
    return [bool(x.size) and not bool(t.uniform[x].all()) for x in values]


def split_values(values: np.ndarray, like) -> list[np.ndarray]:
    """A row of nodes as arrays of the shapes of others."""
    parts = np.split(values, np.cumsum([x.size for x in like])[:-1]) if like else []
    return [part.reshape(x.shape) for part, x in zip(parts, like, strict=True)]


def joined(arrays) -> np.ndarray:
    """All nodes of some arrays in a row."""
    return np.concatenate([np.zeros(0, np.int32), *[x.reshape(-1) for x in arrays]]).astype(
        np.int32
    )


@rule("while")
def while_(t, eqn, *values):
    """Known iterations are written out, the others stay a loop."""
    form = forms.read(eqn)
    if form is None:
        return None
    first, last = form.num_cond_consts, form.num_cond_consts + form.num_body_consts
    cond_consts, consts, carry = values[:first], values[first:last], list(values[last:])
    before = t.size
    while True:
        (proceed,) = evaluate(t, form.cond, [*cond_consts, *carry])
        if not t.is_const(proceed):
            break
        if not t.values(proceed):
            return carry
        if t.size - before > UNROLLED_NODES:
            break
        carry = evaluate(t, form.body, [*consts, *carry])
    flags = _batched(t, [*cond_consts, *consts, *carry])
    on = divergence.equation_flags(eqn, flags)
    proceeds = divergence.program_flags(form.cond, [*flags[:first], *on])[0]
    body = form.body.jaxpr
    same = [v is w for v, w in zip(body.invars[len(consts) :], body.outvars, strict=True)]

    def condition(carry):
        return evaluate(t, form.cond, [*cond_consts, *carry])[0]

    return loop(
        t, carry, on, same, condition, lambda c: evaluate(t, form.body, [*consts, *c]), not proceeds
    )


def loop(t, carry, batched, invariant, condition, body, uniform: bool):
    """Make a loop of nodes; returns what is carried at its end."""
    outside = t.current
    head = t.new_block(outside, outside.depth + 1, outside)
    inside = t.new_block(head, outside.depth + 1, outside)
    moving = [x for x, same in zip(carry, invariant, strict=True) if not same]
    flags = [on for on, same in zip(batched, invariant, strict=True) if not same]
    t.current = head
    params = [_params(t, x, not on) for x, on in zip(moving, flags, strict=True)]
    made = Loop(head, inside, joined(params), joined(moving), uniform=uniform)

    def everything(some):
        rest = iter(some)
        return [x if same else next(rest) for x, same in zip(carry, invariant, strict=True)]

    made.proceed = int(condition(everything(params)))
    t.current = inside
    results = body(everything(params))
    made.nexts = joined([x for x, same in zip(results, invariant, strict=True) if not same])
    t.current = outside
    found = _results(t, made, t.type[made.params], t.uniform[made.params])
    return everything(split_values(found, moving))


def _params(t, x, uniform: bool):
    out = [t.leaf(PARAM, int(t.type[i]), 1, uniform=uniform)[0] for i in x.reshape(-1)]
    return np.array(out, np.int32).reshape(x.shape)


def _results(t, control, kinds, uniform) -> np.ndarray:
    """Nodes of the results of a loop or of branches, after the node of the whole."""
    control.node = int(t.leaf(CONTROL, 0, 1, len(t.controls))[0])
    t.controls.append(control)
    found = [
        t.leaf(RESULT, int(kind), 1, control.node, i, bool(same))[0]
        for i, (kind, same) in enumerate(zip(kinds, uniform, strict=True))
    ]
    return np.array(found, np.int32)


@rule("scan")
def scan(t, eqn, *values):
    """Short ones are written out, others loop over a counter."""
    form = forms.read(eqn)
    if form is None:
        return None
    length, reverse = eqn.params["length"], eqn.params["reverse"]
    last = form.num_consts + form.num_carry
    consts, carry, xs = (
        values[: form.num_consts],
        list(values[form.num_consts : last]),
        values[last:],
    )
    order = range(length - 1, -1, -1) if reverse else range(length)
    if length * jaxprs.length(form.body.jaxpr.eqns) <= UNROLLED_EQUATIONS or length <= 1:
        columns: list[list] = [[] for _ in eqn.outvars[form.num_carry :]]
        for i in order:
            out = evaluate(t, form.body, [*consts, *carry, *[x[i] for x in xs]])
            carry = out[: form.num_carry]
            for column, y in zip(columns, out[form.num_carry :], strict=True):
                column.append(y)
        return [*carry, *_stacked(t, eqn, columns, form.num_carry, reverse)]
    return _scan_loop(t, eqn, form, consts, carry, xs, length, reverse)


def _stacked(t, eqn, columns, first: int, reverse: bool):
    for v, column in zip(eqn.outvars[first:], columns, strict=True):
        rows = column[::-1] if reverse else column
        yield np.stack(rows) if rows else np.zeros(v.aval.shape, np.int32)


def _scan_loop(t, eqn, form, consts, carry, xs, length: int, reverse: bool):
    stacks = [v.aval for v in eqn.outvars[form.num_carry :]]
    if sum(a.size for a in stacks) > LARGEST_STACK:
        raise NotImplementedError("a loop with many results")
    empty = [np.broadcast_to(t.constants(np.zeros((), a.dtype)), a.shape) for a in stacks]
    out_flags = divergence.equation_flags(eqn, _batched(t, [*consts, *carry, *xs]))
    flags = [False, *out_flags]
    one = t.constants(np.int32(1))

    def body(now):
        counter, *state = now
        state, ys = state[: form.num_carry], state[form.num_carry :]
        i = t.apply("sub", t.constants(np.int32(length - 1)), counter) if reverse else counter
        rows = [_row(t, x, i) for x in xs]
        out = evaluate(t, form.body, [*consts, *state, *rows])
        new = [_with_row(t, y, row, i) for y, row in zip(ys, out[form.num_carry :], strict=True)]
        return [t.apply("add", counter, one), *out[: form.num_carry], *new]

    def condition(now):
        return t.apply("lt", now[0], t.constants(np.int32(length)))

    start = [t.constants(np.int32(0)), *carry, *empty]
    inner = form.body.jaxpr
    operands = inner.invars[form.num_consts : form.num_consts + form.num_carry]
    same = [v is w for v, w in zip(operands, inner.outvars[: form.num_carry], strict=True)]
    invariant = [False, *same, *[False] * len(empty)]
    return loop(t, start, flags, invariant, condition, body, True)[1:]


def _row(t, x, i):
    if not x.size:
        return x.reshape(x.shape[1:]) if x.shape[0] == 1 else np.zeros(x.shape[1:], np.int32)
    size = int(np.prod(x.shape[1:], dtype=int))
    start = t.apply("mul", i, t.constants(np.int32(size)))
    return t.load(t.pack(x), start, np.arange(size, dtype=np.int32)).reshape(x.shape[1:])


def _with_row(t, stack, row, i):
    new = stack.copy()
    for k in range(len(stack)):
        here = t.apply("eq", i, t.constants(np.int32(k)))
        new[k] = t.apply("select", here, row, stack[k]) if row.size else row
    return new


@rule("cond")
def cond(t, eqn, index, *operands):
    """A known index chooses; short branches are all computed; else a branch."""
    form = forms.read(eqn)
    if form is None:
        return None
    platform = forms.platform_branch(form, "cpu")
    if platform is not None:
        return evaluate(t, platform, operands)
    branches = form.branches
    if t.is_const(index):
        chosen = int(np.clip(int(t.values(index)), 0, len(branches) - 1))
        return evaluate(t, branches[chosen], operands)
    which = _which(t, index, len(branches))
    outside = t.current
    short = all(jaxprs.length(b.jaxpr.eqns) <= INLINED_BRANCH for b in branches)
    blocks, outs = [], []
    for branch in branches:
        if not short:
            t.current = t.new_block(outside)
            blocks.append(t.current)
        outs.append(evaluate(t, branch, operands))
    t.current = outside
    rows = np.stack([joined(out) for out in outs])
    if short:
        found = rows[-1]
        for condition, row in reversed([*zip(which[:-1], rows[:-1], strict=True)]):
            found = t.apply("select", np.int32(condition), row, found) if row.size else row
        return split_values(found, outs[0])
    found = rows[0].copy()
    differ = np.flatnonzero((rows != rows[0]).any(0))
    made = Branch(which, blocks, [row[differ] for row in rows])
    uniform = t.uniform[rows[:, differ]].all(0) & bool(t.uniform[index])
    found[differ] = _results(t, made, t.type[rows[0, differ]], uniform)
    return split_values(found, outs[0])


def _which(t, index, count: int) -> list[int]:
    """For each branch, whether a lane takes it; indices outside take the first or the last."""
    if count == 1:
        return [int(t.constants(np.asarray(True)))]
    at = lambda name, k: int(t.apply(name, index, t.like(index, k)))  # noqa: E731
    if t.op[index] == OPS["convert"] and t.type[t.args[index, 0]] == BOOL:
        taken = t.args[index, 0]
        return [int(t.apply("not", taken)), int(taken)]
    middle = [at("eq", k) for k in range(1, count - 1)]
    return [at("le", 0), *middle, at("ge", count - 1)]
