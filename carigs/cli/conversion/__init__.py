"""What `carigs convert` does with captures."""
