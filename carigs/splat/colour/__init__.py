"""The colour of a surfel along a view direction: spherical harmonics and light."""
