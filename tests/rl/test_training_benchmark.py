"""`benchmarks/training.py`: medians over seeds, and what counts as reaching a goal."""

import pathlib

import pytest


@pytest.fixture
def training(benchmark_module):
    return benchmark_module("training")


def run(seed, returns, env="hopper"):
    history = [
        {"steps": 1000 * (i + 1), "seconds": 60.0 * (i + 1), "eval_return": value}
        for i, value in enumerate(returns)
    ]
    return {"env": env, "algorithm": "ppo", "seed": seed, "history": history, "in_mujoco": 5.0}


def test_summary_has_medians_over_seeds(training):
    runs = [run(0, [0.0, 2300.0, 2000.0]), run(1, [0.0, 10.0, 2400.0]), run(2, [0.0, 0.0, 0.0])]
    (row,) = training.summary(runs)
    assert (row["seeds"], row["goal"], row["within"]) == (3, 2200, 10)
    assert row["return"] == 2000
    assert row["reached"] == 3  # minutes: after 2, 3, never
    assert row["minutes"] == 3
    assert row["steps/s"] == pytest.approx(2000 / 120)


def test_goal_that_most_seeds_miss_has_no_time(training):
    (row,) = training.summary([run(0, [2300.0]), run(1, [0.0]), run(2, [0.0])])
    assert row["reached"] is None


def test_tasks_without_a_goal_are_listed_too(training):
    (row,) = training.summary([run(0, [1.0, 2.0], env="humanoid")])
    assert (row["goal"], row["reached"], row["return"]) == (None, None, 2.0)


def test_goals_have_tuned_settings(training):
    configs = pathlib.Path(training.__file__).parents[1] / "configs"
    for env in training.GOALS:
        assert (configs / training.USUAL.get(env, "ppo") / f"{env}.yaml").is_file()
