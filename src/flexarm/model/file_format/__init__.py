"""Files of arms, scenarios and studies: YAML text, reading, writing, JSON schemas."""
