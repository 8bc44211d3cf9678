"""Decks for other engines: LAMMPS and LIGGGHTS with clumps of spheres, YADE with convex polyhedra."""

from __future__ import annotations
