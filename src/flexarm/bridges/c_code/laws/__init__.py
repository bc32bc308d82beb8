"""Laws of controllers as functions of symbols."""
