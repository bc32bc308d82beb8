"""C code of the equations of an arm and of controllers."""
