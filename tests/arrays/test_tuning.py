"""Every tuning constant says what it is, what it gains and where that was seen; all are in use."""

import ast
import re
from pathlib import Path

import jaxsim
from jaxsim.arrays import tuning

SOURCE = Path(tuning.__file__)
WORDS = r"\A[A-Z].+\n\nGains: .+\nSeen: ([0-9a-f]{7}|unknown)\.\n\Z"


def test_every_constant_is_described():
    body = ast.parse(SOURCE.read_text()).body[1:]
    assert len(body) % 2 == 0
    for constant, text in zip(body[::2], body[1::2], strict=True):
        assert isinstance(constant, ast.Assign)
        assert isinstance(text, ast.Expr)
        assert re.search(WORDS, ast.literal_eval(text.value), re.S), ast.unparse(constant)


def test_every_constant_is_in_use():
    files = Path(jaxsim.__file__).parent.rglob("*.py")
    used = {name for p in files for name in re.findall(r"\btuning\.([A-Z_]+)", p.read_text())}
    assert used == {name for name in vars(tuning) if name.isupper()}
