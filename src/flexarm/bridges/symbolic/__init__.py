"""The equations of an arm in CasADi and JAX: the kernels' source over the scalars of both."""
