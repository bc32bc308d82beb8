"""The equations of motion as compiled functions of arrays, one algorithm per file."""
