"""Populations of bodies: measured alike, their distributions, compared.

Begin at :func:`~mbstudio.core.populations.measuring.measure_population`.
"""

from mbstudio.core.populations.comparison import PAPER_FACTORS, FactorComparison, compare, relative_errors
from mbstudio.core.populations.distributions import (
    Cdf,
    Density,
    bin_edges,
    cumulative,
    histogram,
    kernel_density,
    moments,
)
from mbstudio.core.populations.form import FormDiagram, sneed_folk_diagram, zingg_diagram
from mbstudio.core.populations.measuring import measure_population
from mbstudio.core.populations.population import Population
from mbstudio.core.populations.sieving import SizeDistribution, size_distribution, standard_sieves

__all__ = [
    "PAPER_FACTORS", "Cdf", "Density", "FactorComparison", "FormDiagram", "Population",
    "SizeDistribution", "bin_edges", "compare", "cumulative", "histogram", "kernel_density",
    "measure_population", "moments", "relative_errors", "size_distribution",
    "sneed_folk_diagram", "standard_sieves", "zingg_diagram",
]  # fmt: skip
