"""The same step for many grains, on several processes."""
