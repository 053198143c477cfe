"""The head model of the toy subject: blendshapes, joints, skinning weights, landmarks, regions."""
