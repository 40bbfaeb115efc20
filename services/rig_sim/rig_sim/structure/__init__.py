"""Lightly damped structures: beams into modes, modes into a state space that is played exactly."""
