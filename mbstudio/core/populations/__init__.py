"""Populations of bodies: measured alike, their distributions, compared.

Begin at :func:`~mbstudio.core.populations.measuring.measure_population`.
"""

from mbstudio.core.populations.bootstrap import Band, Bootstrap, Interval
from mbstudio.core.populations.border import border_weights
from mbstudio.core.populations.classes import FormIndex, class_shares, form_indices, uscs_symbol
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
from mbstudio.core.populations.laboratory import LaboratoryCurve, largest_gap, read_laboratory_table
from mbstudio.core.populations.measuring import measure_population
from mbstudio.core.populations.population import Population
from mbstudio.core.populations.sample_size import (
    Need,
    lognormal_bodies,
    needed_bodies,
    read_off_bodies,
)
from mbstudio.core.populations.sieving import SizeDistribution, size_distribution, standard_sieves
from mbstudio.core.populations.significance import FactorTest, adjust_by_holm, find_differences

__all__ = [
    "Band", "Bootstrap", "Cdf", "Density", "FactorComparison", "FactorTest", "FormDiagram", "FormIndex",
    "Interval", "LaboratoryCurve", "Need", "PAPER_FACTORS", "Population", "SizeDistribution",
    "adjust_by_holm", "bin_edges", "border_weights", "class_shares", "compare", "cumulative",
    "find_differences", "form_indices", "histogram", "kernel_density", "largest_gap", "lognormal_bodies",
    "measure_population", "moments", "needed_bodies", "read_laboratory_table", "read_off_bodies",
    "relative_errors", "size_distribution", "sneed_folk_diagram", "standard_sieves", "uscs_symbol",
    "zingg_diagram",
]  # fmt: skip
