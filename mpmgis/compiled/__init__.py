"""Interface to the compiler and its cache, laws as arguments of kernels, order of particles."""
