"""Algorithms on kinematic trees: kinematics, Featherstone's algorithms, Jacobians, tendons."""
