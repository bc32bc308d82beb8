"""Contract of controllers: their base class, their requirements, checks of their gains."""
