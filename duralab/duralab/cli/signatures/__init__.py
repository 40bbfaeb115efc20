"""What each command takes: its parameters and its help, and no import that would make it slow to start."""
