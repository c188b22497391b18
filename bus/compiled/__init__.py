"""How kernels are compiled: the only place that touches private parts of numba."""
