"""Measures of shape on any closed triangle mesh, one file a measure, and DESCRIPTORS, the table of them all."""
