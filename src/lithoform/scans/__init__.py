"""Stones from elsewhere: scans and spherical harmonics read, repaired, and told what was repaired."""
