"""Exposure and white balance of cameras: datasets in which they differ, and how exactly they are matched."""
