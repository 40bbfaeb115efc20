"""Servo-hydraulic actuators: servovalve, cylinder and the control loop in front of them."""
