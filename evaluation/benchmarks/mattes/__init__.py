"""Mattes that are wrong: datasets with such mattes, and how closely they are mended."""
