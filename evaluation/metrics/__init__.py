"""Metrics on images and embeddings."""
