"""Inverse design: from four descriptors to a setting of the generator whose stones have them."""
