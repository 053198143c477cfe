"""What images tell of the skin: how that of one person moves, and where several cameras show the same of it.

- `face_chart`: a frontal image of the neutral face, into which every frame is unwrapped
- `groupwise_flow`: moves such images onto their common mean
- `own_expressions`: makes blendshapes of movements that those of the head model lack
- `edges`: makes blendshapes that hold the edges of lids and lips where landmarks see them
- `between_views`: finds points of the skin that several cameras show at once
"""
