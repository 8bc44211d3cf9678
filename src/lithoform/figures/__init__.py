"""Figures: results come in, pixels go out, and nothing is computed anew."""
