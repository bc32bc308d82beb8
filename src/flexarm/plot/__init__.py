"""Figures. The only package that imports Matplotlib; it makes figures and saves none."""
