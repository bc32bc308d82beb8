"""Pictures, reports and the studio."""

from flexarm.view import plot as plot
