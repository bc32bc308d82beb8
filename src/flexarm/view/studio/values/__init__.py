"""Fields of a window, and edits and starting values of what they show; without a browser."""
