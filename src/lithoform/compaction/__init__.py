"""The gyratory compactor: specimens of a population, pressed and gyrated (section 6 of the paper)."""
