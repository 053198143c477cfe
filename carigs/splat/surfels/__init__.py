"""The learned attributes of the surfels, their initialization and their files."""
