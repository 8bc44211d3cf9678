"""Databases of particles: a folder of Parquet files that any tool opens."""
