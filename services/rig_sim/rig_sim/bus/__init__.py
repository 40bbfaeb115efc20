"""A rig's part of the contract: interlock, playback with its signal stream, poses, view and FRF."""

__all__ = []
