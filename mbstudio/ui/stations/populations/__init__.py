"""Station Populations: distributions, comparisons and forms of many bodies.

`work` measures, `plots` draw, `link` keeps one selection in all of them. Begin at `station`.
"""
