"""Files of results and figures, validated in advance and written completely or not at all."""

from flexarm.cases.results.formats import (
    FIGURE_SUFFIXES,
    FORMATS,
    MODEL_SUFFIXES,
    encode_netcdf,
    read_result,
    save_linear,
    write_figure,
    write_result,
)

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
