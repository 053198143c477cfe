"""Identity, expressions, poses and cameras from landmarks.

- `landmark_tracking.track_landmarks`: a head in all frames
- `shared_estimate`: what all frames share, which is estimated first
- `tracks`, `objective`, `priors`: landmarks, how well a head explains them, and what is known before
- `personal_expressions`: how one person makes the expressions of a head model
"""
