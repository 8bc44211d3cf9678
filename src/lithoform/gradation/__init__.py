"""Gradations: sieve curves by name, and sizes of particles that meet them."""
