"""The project: its state, its file and its history."""
