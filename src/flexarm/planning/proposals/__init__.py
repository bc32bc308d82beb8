"""Proposals of controllers: candidates for a task, their margins, and their simulations."""
