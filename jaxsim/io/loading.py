"""`load`: from MJCF or URDF to a `Model`, by way of MuJoCo's compiler."""

import difflib
import importlib.resources
import os
import pathlib

import mujoco

from jaxsim.constraint.backward import check_backward
from jaxsim.constraint.laws import LAWS, check_law
from jaxsim.constraint.operators import STRATEGIES
from jaxsim.io import build
from jaxsim.io.budget import contact_budget
from jaxsim.io.materials import Materials
from jaxsim.io.signed_distances import Functions
from jaxsim.model import Model, ModelError
from jaxsim.model.backward import Backward

_BEFORE_XML = "\ufeff \t\r\n"  # a byte order mark, or white space


def load(
    source: str | os.PathLike | mujoco.MjSpec | mujoco.MjModel,
    *,
    max_contacts: int | None = None,
    max_geom_pairs: int | None = None,
    hessian: str = "auto",
    rotations: str = "lie",
    contact: str = "mujoco",
    backward: Backward | None = None,
    materials: Materials | None = None,
    sdf: Functions | None = None,
    unsupported_pairs: str = "error",
) -> Model:
    """Load a model.

    Args:
      source: path of an MJCF or URDF file (`.xml`, `.mjcf`, `.urdf`), the XML itself, the name of
        a bundled model, a `mujoco.MjSpec`, or a compiled `mujoco.MjModel`.
      max_contacts: largest number of simultaneous contacts of each kind. The kind of a contact is
        its condim and whether one or both of its geoms can move. If None, all possible contacts are
        kept where there are at most 64; otherwise the numbers come from simulating the model for a
        few seconds with MuJoCo.
      max_geom_pairs: largest number of geom pairs for each pair of shapes whose contacts are
        computed at a time step. If None, chosen like `max_contacts`.
      hessian: how the constraint solver solves with its Hessian: "articulated" (O(n), but no
        constraint may couple two moving links), "dense", "iterative" (conjugate gradients), or
        "auto" for the fastest of these.
      rotations: what RK4 averages for ball and free joints: "lie", the rates of rotation vectors,
        which is of fourth order, or "mujoco", angular velocities, which is of second order.
      contact: contact law, "mujoco", "sap", "lagged", "hard", or another name in
        `jaxsim.constraint.laws.LAWS`.
      backward: which derivatives a step has, where not those of the program; see
        `jaxsim.gradients.Backward`.
      materials: for each geom, by name, a dictionary of what contact laws other than MuJoCo's
        know of it: "stiffness" (N/m), "relaxation" (s), "restitution". The defaults are 2e6, half a
        time step, and 0.
      sdf: for geoms, by name, a signed distance function: from a point in the geom's frame (m) to
        the distance to its surface (m), negative inside. Or a pair of a function and parameters,
        its second argument; they are `model.sdf[name].parameters`, which can be replaced and
        differentiated. The geom of the file contains the shape; it decides mass and pictures.
      unsupported_pairs: what to do with pairs of geoms that may collide, but have no collision
        function: "error", or "drop" to let them pass through each other with a warning.

    Returns:
      The model, its numbers in JAX's default float type.

    Raises:
      FileNotFoundError: there is no such file, and no bundled model has this name.
      ModelError: the XML is malformed, the model uses unsupported features, or its physics is
        impossible; `problems` lists everything that is wrong.
      TypeError: the source is of another type.
      ValueError: an option has an invalid value.
    """
    if hessian not in ("auto", *STRATEGIES):
        raise ValueError(f"hessian must be one of auto, {', '.join(STRATEGIES)}, got {hessian!r}")
    if rotations not in ("lie", "mujoco"):
        raise ValueError(f"rotations must be lie or mujoco, got {rotations!r}")
    if contact not in LAWS:
        raise ValueError(f"contact must be one of {', '.join(LAWS)}, got {contact!r}")
    if unsupported_pairs not in ("error", "drop"):
        raise ValueError(f"unsupported_pairs must be error or drop, got {unsupported_pairs!r}")
    mj = compile_mujoco(source)
    model = build(mj, unsupported_pairs == "drop", materials, sdf)
    budget = contact_budget(mj, model, max_geom_pairs, max_contacts)
    model = model.replace(hessian=hessian, rotations=rotations, contact=contact)
    model = model.replace(backward=backward or Backward())
    check_law(model)
    check_backward(model)
    return model.replace(max_geom_pairs=budget[0], max_contacts=budget[1])


def compile_mujoco(source) -> mujoco.MjModel:
    """The compiled `mujoco.MjModel` of a source; argument and errors as for `load`."""
    if isinstance(source, mujoco.MjModel):
        return source
    if isinstance(source, mujoco.MjSpec):
        return _compiled(source.compile, "the MjSpec")
    if isinstance(source, str) and source.lstrip(_BEFORE_XML).startswith("<"):
        return _compiled(lambda: mujoco.MjModel.from_xml_string(source), "the XML string")
    if isinstance(source, (str, os.PathLike)):
        return _compiled_file(source)
    raise TypeError(
        "load takes a path, an XML string, the name of a bundled model, a mujoco.MjSpec or a "
        f"mujoco.MjModel, got {type(source).__name__}"
    )


def bundled_models() -> tuple[str, ...]:
    """Names of the models that come with the package."""
    return tuple(
        sorted(p.name.removesuffix(".xml") for p in _assets().iterdir() if p.name.endswith(".xml"))
    )


def bundled_xml(name: str) -> str:
    """The MJCF of a model that comes with the package.

    Raises:
      FileNotFoundError: no bundled model has this name.
    """
    models = bundled_models()
    if name in models:
        return (_assets() / f"{name}.xml").read_text("utf-8")
    near = difflib.get_close_matches(name, models, n=3)
    hint = (
        f"did you mean {' or '.join(near)}?" if near else f"bundled models are {', '.join(models)}"
    )
    raise FileNotFoundError(f"there is no file and no bundled model called {name!r}; {hint}")


def _assets():
    return importlib.resources.files("jaxsim") / "assets"


def _compiled_file(source: str | os.PathLike) -> mujoco.MjModel:
    """Compile the file at a path, or else the bundled model of that name."""
    path = pathlib.Path(source)
    if _is_file(path):
        return _compiled(lambda: mujoco.MjModel.from_xml_path(str(path)), str(path))
    xml = bundled_xml(os.fspath(source))
    return _compiled(lambda: mujoco.MjModel.from_xml_string(xml), f"the bundled model {source}")


def _is_file(path: pathlib.Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # for instance, the path is too long
        return False


def _compiled(compile_, what: str) -> mujoco.MjModel:
    try:
        return compile_()
    except (ValueError, RuntimeError, MemoryError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ModelError(f"MuJoCo cannot compile {what}: {reason}") from error
