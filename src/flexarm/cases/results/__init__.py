"""Files of results and figures, validated in advance and written completely or not at all."""

from flexarm.cases.results.figures import FIGURE_SUFFIXES, write_figure
from flexarm.cases.results.formats import FORMATS, read_result, write_result
from flexarm.cases.results.linear_model import MODEL_SUFFIXES, save_linear
from flexarm.cases.results.netcdf import encode_netcdf

__all__ = [
    "FIGURE_SUFFIXES",
    "FORMATS",
    "MODEL_SUFFIXES",
    "encode_netcdf",
    "read_result",
    "save_linear",
    "write_figure",
    "write_result",
]
