"""Endurance tests: schedules played on a rig for hours to weeks, each repeat monitored and committed."""
