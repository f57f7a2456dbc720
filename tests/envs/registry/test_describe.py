"""Docstrings taken apart, on a class made for it."""

from flax import struct

from jaxsim.envs import Task, static
from jaxsim.envs.registry.describe import Option, describe
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Base(Task):
    """Something shared.

    Attributes:
      weight: of the effort,
        over two lines.
    """

    weight: float = 0.5


@struct.dataclass(kw_only=True)
class Toy(Base):
    """Do what is to be done,
    quickly.

    A remark.

    Observation (4,), of the state after the step:

    | index | what |
    |---|---|
    | 0-3 | all |

    Action (2,): two forces.

    Reward: one.

    Episode: short.

    Gymnasium: not there.

    Brax: its toy is
    another one.

    Attributes:
      model: of the toy.
      flag: whether.
    """

    model: Model
    flag: bool = static(True)


def test_parts():
    page = describe(Toy)
    assert page.summary == "Do what is to be done, quickly."
    assert page.sizes == {"observation": 4, "action": 2}
    labels = ["", "Observation", "Action", "Reward", "Episode", "Gymnasium", "Brax"]
    assert list(page.sections) == labels
    assert page.sections[""] == "A remark."
    assert page.sections["Observation"].startswith("of the state after the step:\n\n| index")
    assert page.sections["Action"] == "two forces."
    assert page.sections["Brax"] == "its toy is\nanother one."


def test_options_are_the_fields_with_meanings_from_all_ancestors():
    assert set(describe(Toy).options) == {
        Option("model", None, "of the toy."),
        Option("frame_skip", 1, "time steps for each action."),
        Option("weight", 0.5, "of the effort, over two lines."),
        Option("flag", True, "whether."),
    }


def test_differences_in_one_paragraph():
    class Other(Toy):
        """Short.

        Differences from Gymnasium's Toy-v5: none. From Brax: none.
        """

    assert describe(Other).sections == {
        "Differences from": "Differences from Gymnasium's Toy-v5: none. From Brax: none."
    }


def test_nothing_documented_is_no_error():
    page = describe(type("Bare", (Toy,), {"__doc__": "Bare."}))
    assert (page.summary, page.sections, page.sizes) == ("Bare.", {}, {})
