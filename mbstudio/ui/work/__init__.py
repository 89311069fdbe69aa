"""What the stations do: each class starts the background work of one and keeps its results."""
