"""Kernels for NVIDIA's GPUs: PTX from LLVM, CUDA's driver, and what XLA calls to launch one."""
