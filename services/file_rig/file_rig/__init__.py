"""Gateway to rig controllers that exchange drive and response files."""
