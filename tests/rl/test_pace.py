"""Steps per second of simulating and learning."""

import jax
import pytest

from jaxsim import envs
from jaxsim.parallel.devices import device_mesh
from jaxsim.rl import config, programs
from jaxsim.rl.bar import Bar
from jaxsim.rl.lookup import algorithm_class
from jaxsim.rl.pace import Pace


@pytest.fixture
def paced(tiny):
    """Function from an algorithm to its `Pace`, once that is compiled, and a training."""

    def build(algorithm):
        cls = algorithm_class(algorithm)
        known = {k: v for k, v in tiny.items() if k in cls.Config.__dataclass_fields__}
        trainer = cls(envs.AutoReset(envs.make("fast")), config.build(cls.Config, known), 1)
        mesh = device_mesh(jax.devices()[:1])
        start = programs.Start(trainer, 0, mesh)
        pace = Pace(trainer, mesh, start.template)
        assert pace.rates(start.program(), 1.0) == {}, "too early"
        pace.compile().result()
        return pace, trainer, start.program()

    return build


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_both_parts_together_are_an_epoch(algorithm, paced):
    pace, trainer, training = paced(algorithm)
    seconds = 40.0
    assert pace.rates(training, seconds) == {}, "that epoch may have been slower"
    rates = pace.rates(training, seconds)
    assert set(rates) == {"simulating", "learning"}
    together = sum(trainer.steps_per_epoch / rate for rate in rates.values())
    assert together == pytest.approx(seconds)
    assert 0 < trainer.steps_per_epoch / rates["learning"] < 1
    assert pace.rates(training, 0.0) == {}, "shorter than learning alone"


def test_not_where_learning_is_no_part_by_itself(paced):
    pace, _, training = paced("shac")
    assert pace.rates(training, 40.0) == pace.rates(training, 40.0) == {}


def test_the_bar_says_both(capsys):
    bar = Bar("ppo")
    bar.training(100, 0)
    bar.pace({"simulating": 3e6, "learning": 2e6})
    bar.close()
    assert "simulating 3,000,000, learning 2,000,000" in capsys.readouterr().err
