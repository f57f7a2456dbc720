"""For which processor kernels are made."""

from jaxsim.lanes.code import machine


def test_kernels_leave_what_xla_is_told_to_leave(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--other=1 --xla_cpu_max_isa=AVX2")
    _, features = machine.processor.__wrapped__()
    assert "+avx512" not in features
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setattr(machine, "processor", lambda: ("", features))
    assert machine.lanes_of.__wrapped__(4) <= 8
