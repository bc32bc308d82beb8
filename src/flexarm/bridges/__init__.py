"""Bridges to other ecosystems, one each; nothing in flexarm needs them."""
