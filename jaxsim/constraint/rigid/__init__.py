"""Rigid contacts and joints: impacts, passes, displacements, and friction without creep."""
