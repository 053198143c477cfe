"""How the skull moves, by the texture of hair and skin that is followed through a video.

- `corners.follow_texture`: corners that are followed from frame to frame
- `bundle_adjustment.BundleAdjustment`: the poses of a rigid body, and the places of corners on it
- `skull_motion.skull_motion`: both together, as points that a tracker can use
"""
