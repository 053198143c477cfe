"""The torso of a person who talks: how it moves, and the bend of the neck between it and the head."""
