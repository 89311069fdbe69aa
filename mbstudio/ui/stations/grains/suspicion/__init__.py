"""Suspicious grains at station Grains: looked for in `work`, told in `card`; begin at `tour`."""
