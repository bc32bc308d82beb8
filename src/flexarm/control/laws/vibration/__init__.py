"""Controllers that damp vibration around another controller."""
