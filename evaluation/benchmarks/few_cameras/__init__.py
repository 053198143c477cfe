"""What a capture of few cameras tells about the outline of the head."""
