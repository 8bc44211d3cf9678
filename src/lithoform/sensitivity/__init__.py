"""Sensitivity of the descriptors: one parameter at a time, screening after Morris, variance shares after Sobol."""
