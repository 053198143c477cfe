"""The rig: face frames, Jacobian blend skinning and the posed head over time."""
