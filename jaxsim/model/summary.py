"""A model in about ten lines."""

from typing import TYPE_CHECKING, Any

import mujoco

if TYPE_CHECKING:
    from jaxsim.model.model import Model

_KINDS = "body joint geom site camera equality tendon actuator sensor key".split()
_WIDEST = 72  # of a list of names


def summary(model: "Model") -> str:
    """Sizes, names of elements and options; numbers that are traced or batched are not told."""
    sizes = ", ".join(f"{name} {getattr(model, name)}" for name in ("nq", "nv", "nu", "na"))
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
    cone = mujoco.mjtCone(model.opt.cone).name.removeprefix("mjCONE_").lower()
    rows = {
        **{kind: _elements(model, kind) for kind in _KINDS},
        "options": f"timestep {_number(model.opt.timestep)} s, {integrator}, {cone} cones",
        "contact": f"{model.contact!r}, at most {model.opt.iterations} iterations",
    }
    return "\n".join([f"Model({sizes})", *(f"  {k:<9} {v}" for k, v in rows.items() if v)])


def _elements(model: "Model", kind: str) -> str:
    """How many of a kind there are, without the world, and their names."""
    names = model.names.of(kind)[kind == "body" :]
    if not names:
        return ""
    listed = ", ".join(filter(None, names))
    if len(listed) > _WIDEST:
        listed = listed[:_WIDEST].rpartition(",")[0] + ", ..."
    return f"{len(names)}: {listed}" if listed else str(len(names))


def _number(leaf: Any) -> str:
    """A number, or the kind of what stands in its place in a batch or a traced program."""
    try:
        return f"{float(leaf):g}"
    except (TypeError, ValueError):
        return f"({getattr(leaf, 'aval', type(leaf).__name__)})"
