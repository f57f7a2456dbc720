"""Rigid-body dynamics of a tree: kinematics, Featherstone's algorithms, forces and energy."""
