"""Bridges to other libraries; no other part of flexarm depends on them."""
