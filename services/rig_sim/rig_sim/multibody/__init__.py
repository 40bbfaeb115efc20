"""Multibody dynamics of a tree of rigid bodies, written once over generic scalars (traced or plain floats)."""
