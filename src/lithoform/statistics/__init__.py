"""Comparison of two populations: histogram indices with their noise floors, distances, effect sizes, tests."""
