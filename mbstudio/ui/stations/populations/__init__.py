"""Station Populations: distributions, comparisons and forms of many bodies."""
