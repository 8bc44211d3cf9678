"""Population design: parameters and dimensions of a population that cannot be told from a reference."""
