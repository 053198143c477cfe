"""Tidy rows, bootstrap intervals and tables."""
