"""The explorer: a local web page with the design space, a studio for single stones, and populations."""
