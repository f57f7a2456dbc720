"""Damaged MJCF files; `fuzz.py` tries as many as one likes."""

import collections

import fuzz
import pytest
from mjcf_mutations import mutated

FILES = 200


def test_damage_can_be_repeated():
    xml = "<mujoco><worldbody><body><joint/><geom size='.1'/></body></worldbody></mujoco>"
    assert [mutated(xml, k) for k in range(20)] == [mutated(xml, k) for k in range(20)]


def test_damaged_files_end_as_models_or_with_a_reason():
    found = list(fuzz.outcomes(0, FILES, programs=2))
    assert [outcome for outcome in found if outcome["wrong"]] == []
    assert [outcome["seed"] for outcome in found] == list(range(FILES))
    ends = collections.Counter(outcome["end"] for outcome in found)
    # Enough of each kind for the test to mean something.
    for end, least in {"malformed": 40, "refused": 1, "loads": 40, "agrees": 5}.items():
        assert ends[end] >= least, ends


@pytest.mark.slow
def test_many_damaged_files():
    wrong = [outcome for outcome in fuzz.outcomes(FILES, 2000, programs=10) if outcome["wrong"]]
    assert wrong == []
