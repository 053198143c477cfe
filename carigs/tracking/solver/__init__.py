"""Identity, expressions, poses and cameras from landmarks.

- `landmark_tracking.track_landmarks`: a head in all frames
- `shared_estimate`: what all frames share, which is estimated first
- `tracks`, `objective`, `priors`: landmarks, how well a head explains them, and what is known before
- `personal_expressions`, `surface_fields`: what one person's head has of its own
"""
