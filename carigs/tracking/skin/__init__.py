"""How the skin of one person moves, beyond what the blendshapes of a head model can do.

- `face_chart`: a frontal image of the neutral face, into which every frame is unwrapped
- `groupwise_flow`: moves such images onto their common mean
- `own_expressions`: makes blendshapes of these movements
"""
