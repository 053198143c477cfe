"""The outline of the tracked head, by the mattes: what landmarks say nothing about, such as ears and profile.

- `skin_colours.SkinColours`: tells skin from hair and clothes at the edge of a matte
- `spatial_field.SpatialField`: smooth displacements in space
- `outline_offset.outline_offset`: a smooth displacement of the head that brings its outline onto the mattes
"""
