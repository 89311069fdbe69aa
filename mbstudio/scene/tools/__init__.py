"""What a hand does in a scene: clip by a box, measure a distance, grip a slice."""
